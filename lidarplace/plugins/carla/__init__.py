"""Scenes from a CARLA server: drive the traffic once, then show it to every placement."""
