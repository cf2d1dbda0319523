"""Rings that coincide: beams of several LiDARs that meet an object at the same heights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement, blocks

DISTANCES_M = (8.0, 12.0, 18.0, 27.0)
"""Distances of the upright strips to look at from the ego frame's z axis, metres."""
AZIMUTHS = tuple(math.radians(degrees) for degrees in range(-60, 61, 20))
"""Azimuths of the strips, radians in the ego frame: ahead, where objects are."""
TOP_M = 1.6
"""Height of the strips, about that of a car, metres."""
CELL_M = 0.05
"""Distance on a strip below which rings are one, metres."""
Item = TypeVar("Item")
LEAST_GAIN = 0.1
"""Smallest gain of redundancy that is worth a caution."""


@dataclass(frozen=True)
class Rings:
    """Cells of strips as high as a car, ahead of the vehicle, that beams meet.

    Attributes:
        hit: cells that one LiDAR or more meets.
        all: the same counted for each LiDAR by itself."""

    hit: int
    all: int

    @property
    def redundancy(self) -> float:
        """Share of the rings that another LiDAR has already, 0 where there is none at all."""
        return 1 - self.hit / self.all if self.all else 0.0


def rings(placement: Placement) -> Rings:
    """Count the rings of a rig on the strips; objects and the block body are not looked at."""
    every = map(blocks, placement.mounts, placement.lidars)
    met = [np.logical_or.reduce([_cells(at, block) for at, block, _ in parts]) for parts in every]
    return Rings(int(np.any(met, axis=0).sum()), int(np.sum(met)))


def spread_by_overlap(
    items: Sequence[Item], placements: Sequence[Placement], number: int
) -> list[Item]:
    """Return `number` of the items, by the rings of the rig of each.

    Those whose rings overlap least and most, and others at even steps between, in this order."""
    shares = [rings(placement).redundancy for placement in placements]
    order = np.argsort(shares, kind="stable")
    steps = np.linspace(0, len(items) - 1, number).round().astype(int)
    return [items[place] for place in order[steps].tolist()]


@dataclass(frozen=True)
class Interleaving:
    """A rig whose LiDARs are pitched until their rings are between each other.

    Attributes:
        placement: the rig, pitched.
        pitches: what was added to the pitch of each mount, radians.
        before, after: redundancy of the rings."""

    placement: Placement
    pitches: tuple[float, ...]
    before: float
    after: float


def beam_gap(lidars: Sequence[Lidar]) -> float:
    """Return the median gap between beams of the LiDARs that turn, radians; 0 without any."""
    turning = [lidar for lidar in lidars if lidar.pattern is None]
    gaps = [np.diff(np.sort(lidar.elevations)) for lidar in turning]
    return float(np.median(np.concatenate(gaps))) if any(map(len, gaps)) else 0.0


def interleaving(placement: Placement) -> Interleaving | None:
    """Return pitches that put rings between each other; None for a gain below `LEAST_GAIN`.

    N LiDARs are pitched by even parts of the gap between two beams, -(N - 1)/2N to (N - 1)/2N of
    it, in the order of the mounts."""
    number = len(placement.mounts)
    gap = beam_gap(placement.lidars)
    pitches = tuple((i - (number - 1) / 2) / number * gap for i in range(number))
    pairs = zip(placement.mounts, pitches, strict=True)
    mounts = [replace(m, pitch=math.fmod(m.pitch + added, math.tau)) for m, added in pairs]
    pitched = replace(placement, mounts=mounts)
    before, after = rings(placement).redundancy, rings(pitched).redundancy
    if before - after < LEAST_GAIN:
        return None
    return Interleaving(pitched, pitches, before, after)


def _cells(mount: Mount, lidar: Lidar) -> NDArray[np.bool_]:
    """Return which cells of the strips a beam meets, shape (strips, cells); a pattern has no rings.

    A beam meets a cell if its elevation is between those of the cell's ends, seen by the sensor."""
    edges = np.arange(0.0, TOP_M + CELL_M / 2, CELL_M)
    foot = np.array([(r * math.cos(a), r * math.sin(a)) for r in DISTANCES_M for a in AZIMUTHS])
    points = np.empty((len(foot), len(edges), 3))
    points[..., :2] = foot[:, None]
    points[..., 2] = edges
    seen = (points - mount.position) @ mount.rotation
    elevation = np.arctan2(seen[..., 2], np.hypot(seen[..., 0], seen[..., 1]))
    low = np.minimum(elevation[:, :-1], elevation[:, 1:])
    high = np.maximum(elevation[:, :-1], elevation[:, 1:])
    beams = np.sort(np.asarray(lidar.elevations))
    # A beam at the border of two cells meets the lower one alone.
    met = np.searchsorted(beams, low, "left") < np.searchsorted(beams, high, "left")
    centres = seen[:, :-1] + (seen[:, 1:] - seen[:, :-1]) / 2
    start, end = lidar.azimuth
    azimuth = np.arctan2(centres[..., 1], centres[..., 0])
    in_view = (azimuth - start) % (2 * math.pi) <= end - start
    near = np.linalg.norm(centres, axis=-1) <= lidar.reach
    turns = lidar.pattern is None
    inside: NDArray[np.bool_] = met & near & (in_view | lidar.full_turn) & turns
    return inside
