"""The commands of `lidarplace` that need sweeps."""
