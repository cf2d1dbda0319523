"""Occupancy of voxels: the POG, its counts and its levels."""
