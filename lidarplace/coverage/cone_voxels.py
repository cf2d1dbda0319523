"""Coverage by voxels: those that range and field of view cut out.

`keep_seen` clears the voxels whose part of the cones is not seen, from coarse to fine: tiles,
blocks of columns, runs of a column, voxels. A voxel of which nobody knows yet is decided by its
corners, then by the exact test of `patch_meets`."""

import numpy as np

from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.coverage.cone_columns import TILE_X, TILE_Y
from lidarplace.coverage.cone_sines import HAIR, box_of, lattice_of
from lidarplace.coverage.cone_view import (
    corners_span,
    near_beams,
    patch_meets,
    side_of_view,
    view_of,
)

_BLOCK = 4  # columns along each side of what is decided at once within a tile
_RUN = 8  # voxels of a column that are decided at once; a divisor of 64


@njit(cache=True, nogil=True, error_model="numpy")
def keep_seen(sensor, grid, bits):
    """Clear the bits that range and field of view exclude; arguments of `cover_tiles`."""
    _, nx, ny = bits.shape
    view, lattice = view_of(sensor), lattice_of(sensor, grid.minimum, grid.resolution)
    for tile_x, tile_y in np.ndindex(grid.lowest.shape):
        k0, k1 = np.int64(grid.lowest[tile_x, tile_y]), np.int64(grid.highest[tile_x, tile_y])
        if k1 < k0:
            continue
        i0, j0 = tile_x * TILE_X, tile_y * TILE_Y
        i1, j1 = min(i0 + TILE_X, nx), min(j0 + TILE_Y, ny)
        low, high = box_of(lattice, (i0, j0, k0), (i1, j1, k1 + 1))
        if side_of_view(low, high, view) != 0:
            continue  # none of it is there to be cleared
        for i in range(i0, i1, _BLOCK):
            for j in range(j0, j1, _BLOCK):
                first, end = (i, j, k0), (min(i + _BLOCK, i1), min(j + _BLOCK, j1), k1 + 1)
                low, high = box_of(lattice, first, end)
                side = side_of_view(low, high, view)
                if side < 0:
                    bits[:, i : end[0], j : end[1]] = 0
                if side == 0:
                    _keep_seen_in(first, end, lattice, sensor, view, bits)


@inner
def _keep_seen_in(first, end, lattice, sensor, view, bits):
    """Clear what is not seen of a block of columns, by runs of their voxels."""
    (i0, j0, k0), (i1, j1, k1) = first, end
    for i in range(i0, i1):
        for j in range(j0, j1):
            for run in range(k0 // _RUN * _RUN, k1, _RUN):
                mask = np.uint64((1 << _RUN) - 1) << np.uint64(run & 63)
                if not bits[run >> 6, i, j] & mask:
                    continue
                low, high = box_of(lattice, (i, j, run), (i + 1, j + 1, run + _RUN))
                side = side_of_view(low, high, view)
                if side < 0:
                    bits[run >> 6, i, j] &= ~mask
                for k in range(run, run + _RUN if side == 0 else run):
                    bit = np.uint64(1) << np.uint64(k & 63)
                    if bits[run >> 6, i, j] & bit and not _is_seen(
                        (i, j, k), lattice, sensor, view
                    ):
                        bits[run >> 6, i, j] ^= bit


@inlined
def _is_seen(voxel, lattice, sensor, view):
    """Return whether the seen part of a cone meets a voxel."""
    (i, j, k), r = voxel, lattice.resolution
    low, high = box_of(lattice, voxel, (i + 1, j + 1, k + 1))
    side = side_of_view(low, high, view)
    if side != 0:
        return side > 0
    half = 0.5 * r + HAIR * r
    centre = lattice.x + (i + 0.5) * r, lattice.y + (j + 0.5) * r, lattice.z + (k + 0.5) * r
    beams = near_beams(centre, half, sensor.sines, view.n)
    if corners_span(centre, half, beams, sensor.sines, view):
        return True
    for b in range(beams[0], beams[1]):
        if patch_meets(low, high, sensor.sines[b], sensor, view):
            return True
    return False
