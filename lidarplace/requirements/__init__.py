"""Requirements: objects around a vehicle that LiDARs must see, and the check of a rig."""
