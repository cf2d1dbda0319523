"""Returns of the recorded rig from every box of a log, as the simulator has them.

The log's ground is not the plane of our ego frame: boxes far away stand metres above or below it.
So rays do not meet a ground here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import NO_ENDS, cast
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

SECTORS = 72
"""Of the azimuth of a LiDAR in its own frame, from -180 degrees on."""

REACH_M = 300.0
"""How far off buildings may hide."""


@dataclass(frozen=True, eq=False)
class Returns:
    """Returns from each box by LiDAR and sector of its azimuth, where there are any.

    Attributes:
        box: row of the log's boxes, int64, shape (N,).
        lidar: number of the LiDAR in its rig, int64, shape (N,).
        sector: of `SECTORS`, int64, shape (N,).
        points: rays that return, float64, shape (N,).
        distance: their mean range, metres, float64, shape (N,).
    """

    box: NDArray[np.int64]
    lidar: NDArray[np.int64]
    sector: NDArray[np.int64]
    points: NDArray[np.float64]
    distance: NDArray[np.float64]


def simulate(log: BoxLog, placement: Placement, frames: Sequence[int], *, seed: int = 0) -> Returns:
    """Cast every LiDAR of a rig in these frames; frames are shared among numba's threads.

    Args:
        log: objects and buildings.
        placement: as recorded.
        frames: numbers of frames of the log.
        seed: of the shapes of the objects.

    Raises:
        ValueError: a box is bad or a frame is not in the log.
    """
    surroundings, body = Surroundings(log, seed), body_parts(None)
    ends = ends_in_rig(placement)

    sectors = {lidar: _sectors(lidar) for lidar in placement.lidars if lidar.pattern is None}

    def of_frame(frame: int) -> list[NDArray[np.float64]]:
        rows, found = surroundings.rows(frame), []
        parts = body.and_(surroundings.parts(frame, REACH_M))
        for number, (mount, model) in enumerate(
            zip(placement.mounts, placement.lidars, strict=True)
        ):
            lidar = model.in_frame(frame)
            met = rays_on_objects(mount, lidar, parts, ends[number])
            sector = sectors[lidar] if lidar in sectors else _sectors(lidar)
            cell = met.target * SECTORS + sector[met.ray]
            points = np.bincount(cell, minlength=len(rows) * SECTORS)
            (hit,) = np.nonzero(points)
            mean = np.bincount(cell, met.range, len(points))[hit] / points[hit]
            lidars = np.full(len(hit), number)
            found.append(np.stack([rows[hit // SECTORS], lidars, hit % SECTORS, points[hit], mean]))
        return found

    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        every = [own for found in threads.map(of_frame, frames) for own in found]
    box, number, sector, points, mean = np.concatenate([np.empty((5, 0)), *every], axis=1)
    rows, lidars, sectors_hit = (key.astype(np.int64) for key in (box, number, sector))
    return Returns(rows, lidars, sectors_hit, points, mean)


class Met(NamedTuple):
    """Rays of a LiDAR that return from objects.

    Attributes:
        ray: their numbers, int64, shape (n,).
        target: number of the object of each in its frame, int64, shape (n,).
        range: metres, float64, shape (n,).
    """

    ray: NDArray[np.int64]
    target: NDArray[np.int64]
    range: NDArray[np.float64]


def rays_on_objects(
    mount: Mount, lidar: Lidar, parts: Parts, ends: NDArray[np.float64] = NO_ENDS
) -> Met:
    """Cast a LiDAR without a ground.

    Args:
        mount, lidar, parts, ends: as of `lidarplace.clouds.raycast.cast`.
    """
    hits = cast(mount, lidar, parts, ends=ends, level=False)
    (ray,) = np.nonzero(hits.target >= 0)
    away = hits.range[ray]
    seen = (away >= lidar.min_range) & (away <= lidar.sight(hits.reflected[ray]))
    return Met(ray[seen], hits.target[ray[seen]].astype(np.int64), away[seen])


def _sectors(lidar: Lidar) -> NDArray[np.int64]:
    """Of every ray, in the order of `Lidar.directions`."""
    x, y, _ = lidar.directions().T
    turn = (np.arctan2(y, x) + math.pi) / (2 * math.pi)
    return np.asarray(np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1))
