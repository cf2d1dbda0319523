"""Rigs at random around given ones: training rigs of a detector that shall judge any of their kind.

Rigs differ in what changes a cloud: heights, tilts, and rings that coincide or are between each
other. Four kinds take turns; of more rigs than are wanted those are kept whose rings overlap least,
most, and at even steps between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.ring_overlap import spread_by_overlap
from lidarplace.rigs.placement import Mount, Placement

NEAR_M = 0.3
"""Distance of a LiDAR of a drawn rig beyond those of the given ones, at most, metres."""
TILT = math.radians(20)
"""Roll and pitch that drawn rigs have at least, radians; more if the given ones have."""
TURN = math.radians(10)
"""Yaw that is added to or taken from a given one's, radians."""
CANDIDATES = 4
"""Number of rigs that are drawn for each that is wanted."""
_SLACK_M, _SLACK = 0.1, math.radians(5)  # no warning: random rigs leave a rest of their space
_APART_M = 0.15
"""Least distance between the centres of two LiDARs."""
Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest of x, y, z, roll and pitch over all mounts, shapes (5,); m and radians."""


def _bounds_of(rigs: Sequence[Placement]) -> Bounds:
    poses = np.array([astuple(mount)[:5] for rig in rigs for mount in rig.mounts])
    return poses.min(axis=0), poses.max(axis=0)


def random_rigs(around: Sequence[Placement], number: int, seed: int) -> list[Placement]:
    """Draw rigs with the LiDARs of given ones, in and somewhat around the space that these take.

    A rig has as many LiDARs as one of the given ones, of the models of that. Rigs are named rig_01,
    …, in the order of the share of rings that coincide."""
    random = np.random.default_rng(seed)
    bounds = _bounds_of(around)
    candidates = []
    for i in range(CANDIDATES * number):
        template = around[int(random.integers(len(around)))]
        candidates.append(_apart(template, _KINDS[i % len(_KINDS)], bounds, random))
    width = len(str(number))
    rigs = spread_by_overlap(candidates, candidates, number)
    return [replace(rig, name=f"rig_{i:0{width}}") for i, rig in enumerate(rigs, start=1)]


def _apart(
    template: Placement,
    kind: Callable[[Placement, Bounds, np.random.Generator], list[Mount]],
    bounds: Bounds,
    random: np.random.Generator,
) -> Placement:
    """Draw a rig of a kind, up to 100 times while its LiDARs are in each other."""
    for _ in range(100):
        rig = replace(template, mounts=kind(template, bounds, random))
        pairs = combinations(rig.mounts, 2)
        if all(math.dist(a.position, b.position) >= _APART_M for a, b in pairs):
            break
    return rig


def _one_height(template: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Draw a rig with given tilts and all LiDARs at one height: rings coincide."""
    z = _height(bounds, random)
    return [replace(_moved(mount, random), z=z) for mount in template.mounts]


def _many_heights(template: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Draw a rig with given tilts and heights anywhere: rings are between each other."""
    return [replace(_moved(m, random), z=_height(bounds, random)) for m in template.mounts]


def _jittered(template: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Draw a given rig whose LiDARs are off by centimetres and a few degrees."""
    scale = [0.1, 0.1, 0.1, TURN / 2, TURN / 2, TURN / 2]
    return [_within_a_turn(astuple(m) + random.uniform(-1, 1, 6) * scale) for m in template.mounts]


def _anywhere(template: Placement, bounds: Bounds, random: np.random.Generator) -> list[Mount]:
    """Draw positions and tilts anywhere; headings as given, as fields of view depend on them."""
    low, high = bounds
    low = np.concatenate([low[:3] - NEAR_M / 2, np.minimum(low[3:], -TILT)])
    high = np.concatenate([high[:3] + NEAR_M / 2, np.maximum(high[3:], TILT)])
    return [
        _within_a_turn([*random.uniform(low, high), mount.yaw + random.uniform(-TURN, TURN)])
        for mount in template.mounts
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
    """Describe how far a rig is outside of the space of others; None if not, or by next to nothing.

    Compared are x, y, z, roll and pitch of the mounts, the number of LiDARs and their models."""
    (least, most), (low, high) = _bounds_of([placement]), _bounds_of(rigs)
    beyond = np.maximum(low - least, most - high).tolist()
    differences = [
        f"{a} by {far:.2f} m" for a, far in zip("xyz", beyond[:3], strict=True) if far > _SLACK_M
    ]
    turned = zip(("roll", "pitch"), beyond[3:], strict=True)
    differences += [
        f"{name} by {math.degrees(far):.1f} deg" for name, far in turned if far > _SLACK
    ]
    numbers = [len(rig.mounts) for rig in rigs]
    if not min(numbers) <= len(placement.mounts) <= max(numbers):
        differences.append(f"{len(placement.mounts)} LiDARs, not {min(numbers)} to {max(numbers)}")
    if has_other_lidar(placement, rigs):
        differences.append("another LiDAR model")
    return ", ".join(differences) or None


def has_other_lidar(placement: Placement, rigs: Sequence[Placement]) -> bool:
    """Return whether a rig has a LiDAR of a model that none of the others has."""
    return not {*placement.lidars} <= {lidar for rig in rigs for lidar in rig.lidars}
