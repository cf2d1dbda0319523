"""Rigs at random around given ones: what a detector learns from that shall judge any of their kind.

Rigs differ in what changes a cloud: heights, tilts, and rings that coincide or lie between each
other. Four kinds take turns; of more rigs than are wanted those are kept whose rings overlap least,
most, and at even steps between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, replace

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.facing import least_distance
from lidarplace.mounting.ring_overlap import spread_by_overlap
from lidarplace.rigs.placement import Mount, Placement

NEAR_M = 0.3
"""How far a LiDAR of a drawn rig may be beyond those of the given ones, metres."""
TILT = math.radians(20)
"""Roll and pitch that drawn rigs have at least, radians; more if the given ones have."""
TURN = math.radians(10)
"""Yaw that is added to or taken from a given one's, radians."""
CANDIDATES = 4
"""So many rigs are drawn for each that is wanted."""
_SLACK_M, _SLACK = 0.1, math.radians(5)
"""Metres and radians that are nothing to warn of: rigs at random fill their space up to a rest."""
_APART_M = 0.15
"""Least distance between the centres of two LiDARs."""
Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest of x, y, z, roll and pitch over all mounts, shapes (5,); m and radians."""


def _bounds_of(rigs: Sequence[Placement]) -> Bounds:
    poses = np.array([astuple(mount)[:5] for rig in rigs for mount in rig.mounts])
    return poses.min(axis=0), poses.max(axis=0)


def random_rigs(around: Sequence[Placement], number: int, seed: int) -> list[Placement]:
    """Rigs with the LiDARs of given ones, in and somewhat around the space that these take. A rig
    has as many LiDARs as one of the given ones, of the models of that. They are named rig_01, …, in
    the order of the share of rings that coincide."""
    random = np.random.default_rng(seed)
    bounds = _bounds_of(around)
    drawn = []
    for i in range(CANDIDATES * number):
        given = around[int(random.integers(len(around)))]
        drawn.append(_apart(given, _KINDS[i % len(_KINDS)], bounds, random))
    width = len(str(number))
    kept = spread_by_overlap(drawn, drawn, number)
    return [replace(rig, name=f"rig_{i:0{width}}") for i, rig in enumerate(kept, start=1)]


def _apart(
    given: Placement,
    kind: Callable[[Placement, Bounds, np.random.Generator], list[Mount]],
    bounds: Bounds,
    random: np.random.Generator,
) -> Placement:
    """A rig of a kind; LiDARs that came to lie in each other are drawn again, up to a point."""
    for _ in range(100):
        rig = replace(given, mounts=kind(given, bounds, random))
        if least_distance(rig) >= _APART_M:
            break
    return rig


def _one_height(given: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Given tilts, all LiDARs as high as each other: rings coincide."""
    z = _height(bounds, random)
    return [replace(_moved(mount, random), z=z) for mount in given.mounts]


def _many_heights(given: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Given tilts, heights anywhere: rings lie between each other."""
    return [replace(_moved(m, random), z=_height(bounds, random)) for m in given.mounts]


def _jittered(given: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """A given rig whose LiDARs are off by centimetres and a few degrees."""
    scale = [0.1, 0.1, 0.1, TURN / 2, TURN / 2, TURN / 2]
    return [_within_a_turn(astuple(m) + random.uniform(-1, 1, 6) * scale) for m in given.mounts]


def _anywhere(given: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Positions and tilts anywhere; headings as given, as fields of view depend on them."""
    low, high = bounds
    low = np.concatenate([low[:3] - NEAR_M / 2, np.minimum(low[3:], -TILT)])
    high = np.concatenate([high[:3] + NEAR_M / 2, np.maximum(high[3:], TILT)])
    return [
        _within_a_turn([*random.uniform(low, high), mount.yaw + random.uniform(-TURN, TURN)])
        for mount in given.mounts
    ]


_KINDS = (_one_height, _many_heights, _jittered, _anywhere)


def _within_a_turn(pose: Iterable[float]) -> Mount:
    x, y, z, *angles = pose
    return Mount(x, y, z, *(math.fmod(angle, math.tau) for angle in angles))


def _moved(mount: Mount, random: np.random.Generator) -> Mount:
    x, y = random.uniform(-NEAR_M, NEAR_M, 2).tolist()
    return replace(mount, x=mount.x + x, y=mount.y + y)


def _height(bounds: Bounds, random: np.random.Generator) -> float:
    return float(random.uniform(bounds[0][2] - NEAR_M / 2, bounds[1][2] + NEAR_M / 2))


def outside(placement: Placement, rigs: Sequence[Placement]) -> str | None:
    """How far a rig is outside of the space of others, None if it is not, or by next to nothing.
    Compared are x, y, z, roll and pitch of the mounts, the number of LiDARs and their models."""
    (least, most), (low, high) = _bounds_of([placement]), _bounds_of(rigs)
    beyond = np.maximum(low - least, most - high).tolist()
    told = [
        f"{a} by {far:.2f} m" for a, far in zip("xyz", beyond[:3], strict=True) if far > _SLACK_M
    ]
    turned = zip(("roll", "pitch"), beyond[3:], strict=True)
    told += [f"{name} by {math.degrees(far):.1f} deg" for name, far in turned if far > _SLACK]
    numbers = [len(rig.mounts) for rig in rigs]
    if not min(numbers) <= len(placement.mounts) <= max(numbers):
        told.append(f"{len(placement.mounts)} LiDARs, not {min(numbers)} to {max(numbers)}")
    if has_other_lidar(placement, rigs):
        told.append("another LiDAR model")
    return ", ".join(told) or None


def has_other_lidar(placement: Placement, rigs: Sequence[Placement]) -> bool:
    """Whether a rig has a LiDAR of a model that none of the others has."""
    return not {*placement.lidars} <= {lidar for rig in rigs for lidar in rig.lidars}
