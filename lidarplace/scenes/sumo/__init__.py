"""Simulated traffic: maps, towns, walks and drives in SUMO, and the box logs of egos."""
