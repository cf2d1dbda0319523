"""Rigs: LiDAR models, mounts, placements, and the catalogue of LiDARs that can be bought."""
