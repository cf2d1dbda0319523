"""Greedy choice from a grid of mounts, and the bound that no choice exceeds."""
