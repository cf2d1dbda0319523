"""The own shadow of every LiDAR, from real clouds: sectors of azimuth from which little returns.

Sky returns nothing either, so only rays count that have something to return from: ground nearby, or
what another LiDAR of the rig sees in that direction. Each sector counts with its best frame."""

import math
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import sedan
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.validation.simulation import SECTORS, sectors_of

SHADOW = 0.6
"""A sector with a smaller share of the returns of open sectors is in shadow; others have none."""

DOWN = (math.sin(math.radians(-20.0)), math.sin(math.radians(-2.2)))
"""Sines of the elevations, in the ego frame, of rays that meet ground within 60 m."""

_SAME, _FAR_M = np.radians(0.5), 8.0
# What another LiDAR sees so near to a ray, and so far away, the ray would meet, too.
_NOTHING = 0.05  # a sector with a smaller share has almost no returns
_OPEN = 0.9  # quantile over sectors: the share of rays that return where nothing is in the way
_AROUND_M = 0.2  # what returns so near to the vehicle is the vehicle


def returned(
    points: NDArray[np.floating],
    lidar: NDArray[np.integer],
    placement: Placement,
    vehicle: Vehicle | None = None,
) -> NDArray[np.float64]:
    """Return the share of rays with something to return from that did, shape (LiDARs, SECTORS).

    NaN where there is no such ray. `points` are x, y, z of a frame in the ego frame, shape (n, 3),
    each of the LiDAR of a number. No vehicle: a sedan."""
    body = (vehicle or sedan()).extents[:, :, :2]
    low, high = body[:, 0].min(axis=0, initial=np.inf), body[:, 1].max(axis=0, initial=-np.inf)
    world = ((points[:, :2] < low - _AROUND_M) | (points[:, :2] > high + _AROUND_M)).any(axis=1)
    rows = []
    for number, (mount, model) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
        seen = points.astype(np.float64) - mount.position
        far = np.linalg.norm(seen, axis=1)
        seen /= np.maximum(far, 1e-9)[:, None]
        others = seen[(lidar != number) & (far > _FAR_M)]
        back, fired = seen[world & (lidar == number)], model.directions() @ mount.rotation.T
        met = np.split(_meets(np.concatenate([back, fired]), others), [len(back)])
        counts = [
            np.bincount(sectors_of(rays[meets] @ mount.rotation), minlength=SECTORS)
            for rays, meets in zip((back, fired), met, strict=True)
        ]
        with np.errstate(invalid="ignore", divide="ignore"):
            rows.append(counts[0] / counts[1])
    return np.array(rows)


def _meets(rays: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether rays go to the ground nearby or to what others see; unit vectors."""
    from scipy.spatial import cKDTree

    met = (rays[:, 2] >= DOWN[0]) & (rays[:, 2] <= DOWN[1])
    rest = np.flatnonzero(~met)
    if len(others) and len(rest):
        away, _ = cKDTree(others).query(rays[rest], distance_upper_bound=_SAME)
        met[rest] = np.isfinite(away)
    return np.asarray(met)


def shadows(shares: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the share of an open sector's returns in each sector, 1 where it is open.

    Shape (LiDARs, SECTORS). `shares` are `returned` of frames, at least one."""
    best = np.max(np.nan_to_num(np.array(shares), nan=np.inf, posinf=np.inf), axis=0)
    best = np.where(np.isfinite(best), best, np.nan)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # no ray goes down
        relative = best / np.nanquantile(best, _OPEN, axis=1, keepdims=True)
    return np.asarray(np.where(relative < SHADOW, relative, 1.0), np.float64)


def widest_shadow(shares: NDArray[np.float64]) -> float:
    """Return the widest azimuth with almost no returns, degrees.

    `shares` are `shadows` of one LiDAR, shape (SECTORS,)."""
    longest = run = 0
    for closed in np.tile(shares < _NOTHING, 2):  # a run may go through ±180 degrees
        run = run + 1 if closed else 0
        longest = max(longest, run)
    return min(longest, SECTORS) * 360 / SECTORS
