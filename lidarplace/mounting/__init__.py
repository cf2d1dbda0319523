"""Limits of mounting: zones, the view past the vehicle, and the near field."""
