"""The verbs of `lidarplace` that need this package alone."""
