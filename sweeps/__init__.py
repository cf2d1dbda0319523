"""Sweeps and searches: configuration, tasks, execution, results and the command line."""

PACKAGES = ("lidarplace", "training", "tracking", "sweeps")
"""Ours: what hashes of code follow, and what nodes of a cluster get."""
