"""The own shadow of every LiDAR, from real clouds: sectors of azimuth from which little returns.

Sky and open ground return nothing either, but the vehicle drives on: in a sector without shadow
some frame has many returns. So a sector counts with its best frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.validation.simulation import SECTORS

SHADOW = 0.6
"""A sector with a smaller share of the returns of open sectors is in shadow; others have none."""

_OPEN = 0.9  # quantile over sectors: the share of rays that return where nothing is in the way


def sectors(
    points: NDArray[np.floating], position: NDArray[np.float64], rotation: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Sector of each of points (n, 3) in the ego frame, in the frame of a LiDAR; shape (n,)."""
    seen = (points.astype(np.float64) - position) @ rotation
    turns = (np.arctan2(seen[:, 1], seen[:, 0]) + math.pi) / (2 * math.pi)
    return np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)


def returned(
    points: NDArray[np.floating], lidar: NDArray[np.integer], placement: Placement
) -> NDArray[np.float64]:
    """Share of the rays of a frame that returned, shape (LiDARs, SECTORS); NaN where none is fired.

    Args:
        points: x, y, z of a frame in the ego frame, shape (n, 3).
        lidar: number of the LiDAR of each, shape (n,).
        placement: of the LiDARs.
    """
    rows = []
    for number, (mount, model) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
        own = sectors(points[lidar == number], mount.position, mount.rotation)
        with np.errstate(invalid="ignore", divide="ignore"):
            rows.append(np.bincount(own, minlength=SECTORS) / _fired(model))
    return np.array(rows)


def _fired(lidar: Lidar) -> NDArray[np.float64]:
    """Rays in each sector, 0 for a sector that the field of view leaves out."""
    turns = (lidar.azimuths() + math.pi) / (2 * math.pi) % 1.0
    own = np.minimum((turns.ravel() * SECTORS).astype(np.int64), SECTORS - 1)
    per_step = 1 if lidar.pattern is not None else lidar.beams
    return np.asarray(np.bincount(own, minlength=SECTORS) * per_step, np.float64)


def shadows(shares: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """What every sector returns of what open ones do, 1 where it is open; (LiDARs, SECTORS).

    Args:
        shares: `returned` of frames, at least one.
    """
    best = np.nanmax(np.nan_to_num(np.array(shares), nan=-1.0), axis=0)
    best[best < 0] = np.nan
    relative = best / np.nanquantile(best, _OPEN, axis=1, keepdims=True)
    return np.asarray(np.where(relative < SHADOW, relative, 1.0), np.float64)
