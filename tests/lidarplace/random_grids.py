"""Grids of two classes with counts at random."""

import numpy as np

from lidarplace import OccupancyGrid, Roi


def random_grids(roi: Roi) -> dict[str, OccupancyGrid]:
    """Of 100 frames; some voxels are never occupied."""
    rng = np.random.default_rng(3)
    grids = {}
    for name, most in (("Car", 60), ("Pedestrian", 9)):
        counts = rng.integers(0, most, roi.shape).astype(np.int32)
        counts[counts > most // 2] = 0
        grids[name] = OccupancyGrid(roi, name, counts, 100)
    return grids
