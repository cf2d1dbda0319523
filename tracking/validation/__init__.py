"""Command and page that compare the simulator with real points."""
