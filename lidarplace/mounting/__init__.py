"""What a vehicle allows its LiDARs: zones for mounts, its own body in view, what is near it."""
