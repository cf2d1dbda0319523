"""A better pose for one LiDAR of a rig, all others staying where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lidarplace.mounting.vehicle import depth_in
from lidarplace.mounting.zone import Zone, distance, position
from lidarplace.placement import Mount, Placement
from lidarplace.recall.choice import RecallChoice
from lidarplace.studio.numbers import Meter, thinned
from lidarplace.studio.rigs_file import RigsFile

ROUNDS = 4
PER_ROUND = 32
"""Poses that are tried in each round; each round looks half as far around the best so far."""
TURN_DEG = (10.0, 20.0, 20.0)
"""How far roll, pitch and yaw go in the first round."""
AROUND_M = 0.4
"""How far a LiDAR goes to each side where there are no zones."""
RAYS = 20_000
"""Of a LiDAR in a frame while poses are compared."""


@dataclass(frozen=True)
class Improved:
    """A better pose, or the old one.

    Attributes:
        mount: the pose, in whole millimetres and tenths of a degree.
        before, after: mean of `expected_recall` over the classes that there are, of all rays.
    """

    mount: Mount
    before: float
    after: float


def improved(placement: Placement, number: int, file: RigsFile, meter: Meter) -> Improved:
    """Look for the pose of LiDAR `number` with which the rig finds most.

    Rounds of poses from a Sobol sequence, in the zone in which it is (or which is nearest) and
    some degrees around, are compared with few rays; the best is kept only if it is better with
    all. What would be inside of the body or closer to another LiDAR than allowed is not tried.
    """
    old = placement.mounts[number]
    zone = _zone_of(old, file)
    best, reach = old, 1.0
    for round_ in range(ROUNDS):
        tried = [best, *_around(best, zone, reach, file, placement, number, round_)]
        best = tried[int(np.argmax(_worth(placement, number, tried, meter)))]
        reach *= 0.5
    before = _mean(placement, meter)
    after = _mean(_with(placement, number, best), meter)
    return Improved(best, before, after) if after > before else Improved(old, before, before)


def _zone_of(mount: Mount, file: RigsFile) -> Zone:
    at = mount.x, mount.y, mount.z
    if file.zones:
        return min(file.zones, key=lambda zone: distance(zone, *at))
    x, y, z = ((value - AROUND_M, value + AROUND_M) for value in at)
    return Zone.box("around", x, y, z)


def _around(
    best: Mount, zone: Zone, reach: float, file: RigsFile, rig: Placement, number: int, seed: int
) -> Iterator[Mount]:
    """Allowed poses around the best one; in the first round, of the whole zone."""
    others = np.array([m.position for i, m in enumerate(rig.mounts) if i != number]).reshape(-1, 3)
    for draw in qmc.Sobol(6, rng=seed).random(PER_ROUND):
        at = np.array(position(zone, *draw[:3]))
        at = best.position + reach * (at - best.position) if seed else at
        at = at.round(3)
        if distance(zone, *at.tolist()) > 1e-3:  # a millimetre by rounding, or not convex
            continue
        if depth_in(file.body.interior, at[None])[0] > 0:
            continue
        apart = np.linalg.norm(others - at, axis=1).min(initial=math.inf)
        if apart < max(file.settings.constraints.distance, 1e-3):
            continue
        turn = np.degrees(astuple(best)[3:]) + reach * np.array(TURN_DEG) * (2 * draw[3:] - 1)
        yield Mount.degrees(*at.tolist(), *turn.round(1).tolist())


def _with(rig: Placement, number: int, mount: Mount) -> Placement:
    mounts = [*rig.mounts[:number], mount, *rig.mounts[number + 1 :]]
    return Placement(rig.name, mounts, lidar=rig.lidars)


def _worth(rig: Placement, number: int, tried: list[Mount], meter: Meter) -> NDArray[np.float64]:
    """What each of the poses adds to the other LiDARs, with few rays."""
    few = thinned(rig, RAYS)
    others = [i for i in range(len(rig.mounts)) if i != number]
    alone = [Placement("one", [few.mounts[i]], lidar=few.lidars[i]) for i in others]
    alone += [Placement("one", [mount], lidar=few.lidars[number]) for mount in tried]
    seen = meter.recall.objects.seen_by(alone)
    weights = dict.fromkeys(meter.recall.classes, 1.0)
    gains = RecallChoice(meter.recall, seen, weights).gains(range(len(others)))
    return gains[len(others) :]


def _mean(rig: Placement, meter: Meter) -> float:
    return float(np.nanmean(list(meter.measure(rig).expected_recall.values())))
