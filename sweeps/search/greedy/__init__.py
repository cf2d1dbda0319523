"""Greedy choice from a grid of mounts, and an upper bound on every choice."""
