"""What LiDARs have to see around a vehicle, and whether a rig does: objects placed all over it."""
