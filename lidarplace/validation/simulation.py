"""Returns of the recorded rig from every box of a log, as the simulator has them.

Where the log has no static world there is no ground, as boxes far away stand metres above or below
a plane."""

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
from lidarplace.clouds.raycast import NO_ENDS, cast
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.static_world import stop_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.worlds import WorldAround
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

SECTORS = 72  # of the azimuth of a LiDAR in its own frame, from -180 degrees on

REACH_M = 300.0  # how far off buildings may hide


@dataclass(frozen=True, eq=False)
class Returns:
    """Returns from each box by LiDAR and sector of its azimuth, where there are any; shape (N,)."""

    box: NDArray[np.int64]  # row of the log's boxes
    lidar: NDArray[np.int64]  # number of the LiDAR in its rig
    sector: NDArray[np.int64]  # of `SECTORS`
    points: NDArray[np.float64]  # rays that return
    distance: NDArray[np.float64]  # their mean range, metres

    def shares(self, mask: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of a mask, (LiDARs, SECTORS), for each row; shape (N,)."""
        return np.asarray(mask[self.lidar, self.sector])


class ObjectRays(NamedTuple):
    """Rays of a LiDAR that return from objects, shape (n,)."""

    ray: NDArray[np.int64]  # their numbers
    target: NDArray[np.int64]  # number of the object of each in its frame
    range: NDArray[np.float64]  # metres


@dataclass(frozen=True, eq=False)
class SimulatedRig:
    """A rig in the frames of a log that it recorded.

    `surroundings` raise ValueError: a box is bad, or a scene with a static world has a frame
    without a pose."""

    log: BoxLog
    placement: Placement
    seed: int = 0  # of the shapes of the objects
    vehicle: Vehicle | None = None  # carries the rig; None: a sedan

    @cached_property
    def surroundings(self) -> Surroundings:
        """Objects, buildings and static world of the log."""
        return Surroundings(self.log, self.seed)

    @cached_property
    def _ends(self) -> list[NDArray[np.float64]]:
        return ends_in_rig(self.placement, self.vehicle)

    def object_rays(self, frame: int) -> list[ObjectRays]:
        """Cast the rays of each LiDAR in a frame; raise ValueError if it is not listed."""
        parts = body_parts(self.vehicle).and_(self.surroundings.parts(frame, REACH_M))
        world = self.surroundings.world(frame)
        views = zip(self.placement.mounts, self.placement.lidars, self._ends, strict=True)
        return [rays_on_objects(m, li.in_frame(frame), parts, world, e) for m, li, e in views]


def simulate(recording: SimulatedRig, frames: Sequence[int]) -> Returns:
    """Cast every LiDAR in these frames, which are shared among numba's threads."""
    surroundings, lidars = recording.surroundings, recording.placement.lidars
    fixed = {lidar: sectors_of(lidar.directions()) for lidar in lidars if lidar.pattern is None}

    def of_frame(frame: int) -> NDArray[np.float64]:
        rows, columns = surroundings.rows(frame), [np.empty((5, 0))]
        rays_of = recording.object_rays(frame)
        for number, (lidar, rays) in enumerate(zip(lidars, rays_of, strict=True)):
            sector = fixed.get(lidar)
            if sector is None:
                sector = sectors_of(lidar.in_frame(frame).directions())
            cell = rays.target * SECTORS + sector[rays.ray]
            hit, points = np.unique(cell, return_counts=True)
            mean = np.bincount(cell, rays.range)[hit] / points
            of_lidar = np.full(len(hit), number)
            columns.append(np.stack([rows[hit // SECTORS], of_lidar, hit % SECTORS, points, mean]))
        return np.concatenate(columns, axis=1)

    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        every = np.concatenate([np.empty((5, 0)), *threads.map(of_frame, frames)], axis=1)
    keys, (points, mean) = np.split(every, [3])
    box, lidar, sector = keys.astype(np.int64)
    return Returns(box, lidar, sector, points, mean)


def rays_on_objects(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    world: WorldAround | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
) -> ObjectRays:
    """Cast a LiDAR without flat ground; arguments as of `cast_in_world`."""
    hits = cast(mount, lidar, parts, ends=ends, level=False)
    if world is not None:
        stop_in_world(mount, lidar, hits, world, only_objects=True, level=False)
    (ray,) = np.nonzero(hits.target >= 0)
    away = hits.range[ray]
    seen = (away >= lidar.min_range) & (away <= lidar.sight(hits.reflected[ray]))
    return ObjectRays(ray[seen], hits.target[ray[seen]].astype(np.int64), away[seen])


def sectors_of(directions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the sectors of directions in the frame of a LiDAR, shape (n, 3) to (n,)."""
    turns = (np.arctan2(directions[:, 1], directions[:, 0]) + math.pi) / (2 * math.pi)
    return np.asarray(np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1))
