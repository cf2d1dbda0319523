"""Compare the simulator with what a log's own LiDARs returned, and fit what corrects it."""
