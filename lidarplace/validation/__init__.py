"""Compare the simulator with the returns of a log's own LiDARs, and fit a correction."""
