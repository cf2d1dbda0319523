"""What single rays give a voxel: coverage, the number of rays, and the chance to be detected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.coverage.bresenham import bresenham_voxels
from lidarplace.coverage.dda import dda_voxels
from lidarplace.placement import Placement
from lidarplace.roi import Roi

RayMethod = Literal["dda", "bresenham"]
_WALKS = {"dda": dda_voxels, "bresenham": bresenham_voxels}


def covered_by_rays(placement: Placement, roi: Roi, method: RayMethod) -> NDArray[np.bool_]:
    """Voxels that at least one ray of `placement` passes, shape (nx, ny, nz)."""
    covered = np.zeros(roi.shape, np.bool_)
    for voxels, _ in _beams(placement, roi, method):
        covered.reshape(-1)[voxels] = True
    return covered


def ray_counts(placement: Placement, roi: Roi, method: RayMethod) -> NDArray[np.int32]:
    """m(v), the number of rays through every voxel, shape (nx, ny, nz)."""
    counts = np.zeros(roi.shape, np.int32)
    for voxels, _ in _beams(placement, roi, method):
        _count_rays(voxels, counts.reshape(-1))
    return counts


def log_miss(
    placement: Placement,
    roi: Roi,
    method: RayMethod,
    probability: NDArray[np.float64],
    detection_probability: float,
) -> NDArray[np.float64]:
    """`ln prod over rays of (1 - q w_r)`: the log-probability that no ray detects an object at v.

    Ray r reaches voxel v with probability `w_r = prod (1 - p)` over the voxels before v
    (`expected_ig` with occlusion). Shape (nx, ny, nz), <= 0.
    """
    with np.errstate(divide="ignore"):
        log_free = np.log1p(-probability).reshape(-1)
    result = np.zeros(roi.shape)
    for voxels, offsets in _beams(placement, roi, method):
        _add_log_miss(voxels, offsets, log_free, detection_probability, result.reshape(-1))
    return result


def _beams(
    placement: Placement, roi: Roi, method: RayMethod
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Voxels and offsets of one beam of one LiDAR after the other, to keep the lists short."""
    for mount in placement.mounts:
        for elevation in placement.lidar.elevations:
            beam = replace(placement.lidar, elevations=(elevation,))
            directions = beam.directions() @ mount.rotation.T
            yield _WALKS[method](
                mount.position,
                directions,
                placement.lidar.range,
                roi.minimum,
                roi.resolution,
                *roi.shape,
            )


@njit(cache=True)
def _count_rays(voxels, counts):  # pragma: no cover - compiled
    for v in voxels:
        counts[v] += 1


@njit(cache=True)
def _add_log_miss(voxels, offsets, log_free, q, result):  # pragma: no cover - compiled
    for r in range(len(offsets) - 1):
        log_reach = 0.0
        for v in voxels[offsets[r] : offsets[r + 1]]:
            if log_reach == -math.inf:
                break
            result[v] += math.log1p(-q * math.exp(log_reach))
            log_reach += log_free[v]
