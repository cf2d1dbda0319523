"""How often voxels are occupied: the POG, what it is counted from and what it holds."""
