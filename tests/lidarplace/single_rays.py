"""Voxels of single rays, which the library hands over in chunks only."""

import numpy as np

from lidarplace.coverage.rays import VoxelGrid, VoxelLists, clip_rays, walk_rays


def voxels_of_rays(method, origin, directions, reach, grid):
    """Flat C-order indices and offsets: ray r has `voxels[offsets[r]:offsets[r + 1]]`.

    grid: minimum, resolution and shape.
    """
    minimum, resolution, shape = grid
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    voxel_grid = VoxelGrid(minimum.astype(np.float64), resolution, np.array(shape), strides)
    spans = clip_rays(origin, directions, reach, voxel_grid)
    voxels = np.empty(len(directions) * sum(shape), np.uint32)
    offsets = np.zeros(len(directions) + 1, np.int64)
    bresenham = method == "bresenham"
    lists = VoxelLists(voxels, offsets)
    walk_rays(bresenham, origin, directions, spans, reach, voxel_grid, lists)
    return voxels[: offsets[-1]], offsets
