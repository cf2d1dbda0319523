"""The verbs of `lidarplace` that need sweeps."""
