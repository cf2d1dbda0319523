"""Returns of the recorded rig from every box of a log, as the simulator has them.

Rays end at the static world of the log, where it has one. The log's ground is not the plane of our
ego frame: boxes far away stand metres above or below it. Where it has no ground, there is none.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import NO_ENDS
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.static_world import WorldAround, cast_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
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


@dataclass(frozen=True, eq=False)
class Recording:
    """A rig in the frames of a log that it recorded.

    Attributes:
        log: objects, buildings and static world.
        placement: the rig.
        seed: of the shapes of the objects.
        vehicle: carries the rig; None: a sedan.

    Raises:
        ValueError: a box is bad, or a scene with a static world has a frame without a pose.
    """

    log: BoxLog
    placement: Placement
    seed: int = 0
    vehicle: Vehicle | None = None

    @cached_property
    def surroundings(self) -> Surroundings:
        """Of the log."""
        return Surroundings(self.log, self.seed)

    @cached_property
    def _ends(self) -> list[NDArray[np.float64]]:
        return ends_in_rig(self.placement, self.vehicle)

    def met(self, frame: int) -> list[Met]:
        """What the rays of each LiDAR meet in a frame. Raises ValueError if it is not listed."""
        parts = body_parts(self.vehicle).and_(self.surroundings.parts(frame, REACH_M))
        world = self.surroundings.world(frame)
        views = zip(self.placement.mounts, self.placement.lidars, self._ends, strict=True)
        return [
            rays_on_objects(mount, lidar.in_frame(frame), parts, world, ends)
            for mount, lidar, ends in views
        ]


def simulate(recording: Recording, frames: Sequence[int]) -> Returns:
    """Cast every LiDAR in these frames, which are shared among numba's threads.

    Raises:
        ValueError: as `Recording` does.
    """
    surroundings, lidars = recording.surroundings, recording.placement.lidars
    fixed = {own: sectors_of(own.directions()) for own in lidars if own.pattern is None}

    def of_frame(frame: int) -> list[NDArray[np.float64]]:
        rows, found = surroundings.rows(frame), []
        for number, (lidar, met) in enumerate(zip(lidars, recording.met(frame), strict=True)):
            sector = fixed.get(lidar)
            if sector is None:
                sector = sectors_of(lidar.in_frame(frame).directions())
            cell = met.target * SECTORS + sector[met.ray]
            points = np.bincount(cell, minlength=len(rows) * SECTORS)
            (hit,) = np.nonzero(points)
            mean = np.bincount(cell, met.range, len(points))[hit] / points[hit]
            of_lidar = np.full(len(hit), number)
            found.append(
                np.stack([rows[hit // SECTORS], of_lidar, hit % SECTORS, points[hit], mean])
            )
        return found

    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        every = [own for found in threads.map(of_frame, frames) for own in found]
    box, number, sector, points, mean = np.concatenate([np.empty((5, 0)), *every], axis=1)
    rows, numbers, sectors_hit = (key.astype(np.int64) for key in (box, number, sector))
    return Returns(rows, numbers, sectors_hit, points, mean)


def rays_on_objects(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    world: WorldAround | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
) -> Met:
    """Cast a LiDAR without flat ground; arguments as of `cast_in_world`."""
    hits = cast_in_world(mount, lidar, parts, world, ends=ends, only_objects=True, level=False)
    (ray,) = np.nonzero(hits.target >= 0)
    away = hits.range[ray]
    seen = (away >= lidar.min_range) & (away <= lidar.sight(hits.reflected[ray]))
    return Met(ray[seen], hits.target[ray[seen]].astype(np.int64), away[seen])


def sectors_of(directions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Sector of directions in the frame of a LiDAR, shape (n, 3) to (n,)."""
    turns = (np.arctan2(directions[:, 1], directions[:, 0]) + math.pi) / (2 * math.pi)
    return np.asarray(np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1))
