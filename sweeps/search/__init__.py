"""The search for placements: `lidarplace search search.yaml`."""
