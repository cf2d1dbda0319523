"""Returns of the recorded rig from every box of a log, as the simulator has them.

The log's ground is not the plane of our ego frame: boxes far away stand metres above or below it.
So rays do not meet a ground here. Everything is cast deep below z = 0, where there is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.raycast import EVERYWHERE, along, beams_of, cast_compiled, returns_light
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.placement import Placement

SECTORS = 72
"""Of the azimuth of a LiDAR in its own frame, from -180 degrees on."""

DEPTH_M = 1000.0


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

    def of_frame(frame: int) -> list[NDArray[np.float64]]:
        rows, found = surroundings.rows(frame), []
        around = lowered(body.and_(surroundings.parts(frame, 300.0)))
        for number, (mount, lidar) in enumerate(
            zip(placement.mounts, placement.lidars, strict=True)
        ):
            counts, ranges = _counts(
                mount.position - [0.0, 0.0, DEPTH_M],
                mount.rotation,
                beams_of(lidar.in_frame(frame)),
                around.geometry,
                around.owner,
                around.reflectivity,
                np.array(EVERYWHERE),
                ends[number],
                len(rows),
            )
            box, sector = np.nonzero(counts)
            hit = counts[box, sector]
            columns = (rows[box], np.full(len(box), number), sector, hit, ranges[box, sector] / hit)
            found.append(np.stack(columns))
        return found

    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        every = [own for found in threads.map(of_frame, frames) for own in found]
    box, lidar, sector, points, distance = np.concatenate([np.empty((5, 0)), *every], axis=1)
    return Returns(
        box.astype(np.int64), lidar.astype(np.int64), sector.astype(np.int64), points, distance
    )


def lowered(parts: Parts) -> Parts:
    """The same parts far below the ground, which therefore hides none of them."""
    geometry = parts.geometry.copy()
    geometry[:, 2] -= DEPTH_M
    return Parts(geometry, parts.owner, parts.reflectivity)


@njit(cache=True, nogil=True, error_model="numpy")
def _counts(
    origin, rotation, beams, parts, owners, reflectivities, crop, ends, boxes
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # pragma: no cover - compiled
    """Returns and sums of their ranges by box and sector, both shape (boxes, SECTORS)."""
    steps = beams.azimuths.shape[2]
    rays = len(beams.elevations) * steps
    hits = np.empty(rays), np.empty(rays, np.int32), np.empty(rays)
    ranges, targets, reflected = hits
    cast_compiled(origin, rotation, beams, parts, owners, reflectivities, crop, ends, hits)
    counts, sums = np.zeros((boxes, SECTORS)), np.zeros((boxes, SECTORS))
    for beam in range(len(beams.elevations)):
        cosines, sines = along(beams, beam)
        for step in range(steps):
            ray = beam * steps + step
            b = targets[ray]
            if b < 0 or not returns_light(ranges[ray], reflected[ray], beams):
                continue
            turn = (math.atan2(sines[step], cosines[step]) + math.pi) / (2 * math.pi)
            sector = min(int(turn * SECTORS), SECTORS - 1)
            counts[b, sector] += 1.0
            sums[b, sector] += ranges[ray]
    return counts, sums
