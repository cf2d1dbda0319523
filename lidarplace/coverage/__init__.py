"""Coverage: the voxels of the ROI that a placement covers, V|C in the paper."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.coverage.bits import Bits, pack, unpack
from lidarplace.coverage.cone import cone_bits
from lidarplace.coverage.rays import RayMethod, covered_by_rays
from lidarplace.coverage.tiles import Tiles
from lidarplace.rigs.placement import Placement

Method = Literal["cone", "dda", "bresenham"]
METHODS: tuple[Method, ...] = get_args(Method)


def check_method(method: str) -> None:
    """Raise ValueError unless `method` is one of METHODS."""
    if method not in METHODS:
        raise InputError(key="method", expected=", ".join(METHODS), found=repr(method))


def rays_of(method: Method) -> RayMethod:
    """Return how rays are traced for surrogates that need single rays: by `dda` for cones."""
    return "bresenham" if method == "bresenham" else "dda"


def coverage(placement: Placement, roi: Roi, method: Method = "cone") -> NDArray[np.bool_]:
    """Return the covered voxels, shape (nx, ny, nz).

    `method` is `cone`, exact and without azimuth sampling; `dda`, exact traversal of the rays of
    all azimuth steps; or `bresenham`, the paper's integer lines along the same rays. Raises
    ValueError for another one."""
    return unpack(covered_bits(placement, roi, method, Tiles.whole(roi.shape)), roi.shape[2])


def covered_bits(placement: Placement, roi: Roi, method: Method, tiles: Tiles) -> Bits:
    """Return covered voxels as a set of bits, right for the voxels that matter by `tiles`."""
    check_method(method)
    if method == "cone":
        return cone_bits(placement, roi, tiles)
    return pack(covered_by_rays(placement, roi, method))


def count_covered(placement: Placement, roi: Roi, method: Method) -> int:
    """Return the number of covered voxels of the whole ROI."""
    bits = covered_bits(placement, roi, method, Tiles.whole(roi.shape))
    return int(np.bitwise_count(bits).sum())
