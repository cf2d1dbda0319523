"""From points to features: pillars, voxels, sampled points."""
