"""The commands of `lidarplace` that need this package only."""
