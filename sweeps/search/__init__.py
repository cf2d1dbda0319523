"""The search for placements: `python -m sweeps.search search.yaml`."""
