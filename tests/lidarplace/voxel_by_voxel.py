"""Coverage by cones, by the test of every single voxel: slower than by column, always valid."""

import numpy as np

from lidarplace.base.kernel_cache import njit
from lidarplace.coverage.cone import around, sensor_of
from lidarplace.coverage.cone_sines import box_of, lattice_of, sine_range, sines_between
from lidarplace.coverage.cone_view import patch_meets, side_of_view, view_of
from lidarplace.rigs.placement import blocks


def covered_voxel_by_voxel(placement, roi):
    """`coverage` of the placement: the range of `n.d/|d|` over a cube holds the sine of a beam."""
    covered = np.zeros(roi.shape, np.bool_)
    for mount, lidar in zip(placement.mounts, placement.lidars, strict=True):
        for block_mount, block, _ in blocks(mount, around(lidar)):
            _cover(sensor_of(block, block_mount), roi.minimum, roi.resolution, covered)
    return covered


@njit(error_model="numpy")
def _cover(sensor, minimum, resolution, covered):
    view, sines, lattice = view_of(sensor), sensor.sines, lattice_of(sensor, minimum, resolution)
    for i, j, k in np.ndindex(covered.shape):
        low, high = box_of(lattice, (i, j, k), (i + 1, j + 1, k + 1))
        side = side_of_view(low, high, view)
        if covered[i, j, k] or side < 0:
            continue
        first, last = sines_between(sines, *sine_range(low, high, view.n))
        for b in range(first, last):
            if side > 0 or patch_meets(low, high, sines[b], sensor, view):
                covered[i, j, k] = True
                break
