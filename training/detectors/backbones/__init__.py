"""Backbones, from points to features: pillars, voxels, sampled points."""
