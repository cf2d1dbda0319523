"""Which voxels of the ROI a placement covers: V|C in the paper."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from lidarplace.coverage.cone import covered_by_cones
from lidarplace.coverage.rays import covered_by_rays
from lidarplace.placement import Placement
from lidarplace.roi import Roi

Method = Literal["cone", "dda", "bresenham"]
METHODS: tuple[Method, ...] = get_args(Method)


def coverage(placement: Placement, roi: Roi, method: Method = "cone") -> NDArray[np.bool_]:
    """Covered voxels, shape (nx, ny, nz).

    Args:
        method: `cone`, exact and without azimuth sampling; `dda`, exact traversal of the rays of
            all azimuth steps; `bresenham`, the paper's integer lines along the same rays.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, found {method!r}")
    if method == "cone":
        return covered_by_cones(placement, roi)
    return covered_by_rays(placement, roi, method)
