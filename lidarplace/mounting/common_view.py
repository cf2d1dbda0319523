"""How much of what one sensor sees another one sees, too: what calibration of the two needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.mounting.field_of_view import View, has_direction, in_view
from lidarplace.mounting.housing import housings_in
from lidarplace.mounting.sight import Obstacles, obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement

ROWS, STEPS = 128, 240
"""Elevations, and azimuths of each, at which a field of view is looked at. Between azimuths its
edges are found by bisection. The share of two tilted LiDARs of the paper is right to 0.001."""
_HALVINGS = 16

Pair = tuple[int, int]


@dataclass(frozen=True)
class CommonView:
    """What pairs of sensors have to see in common.

    Attributes:
        pairs: all of them; chain: so many that each sensor is connected with each other one, over
            others; or these, numbers from 0.
        share: of the smaller field of view, less what the vehicle hides of it.
        range: at which it is looked at, metres from the sensor with the smaller one, or at the
            reach of the two if that is less.
    """

    pairs: Literal["all", "chain"] | tuple[Pair, ...]
    share: float
    range: float


def shares(views: Sequence[View], pairs: Sequence[Pair], range_m: float,
           obstacles: Obstacles) -> dict[Pair, float]:
    """The share of the smaller field of view of each pair that both see.

    The smaller is the one with the smaller solid angle; of two that are alike the first. One of no
    solid angle, such as that of a single beam, is taken for what it goes around.

    Args:
        views: of all sensors; LiDARs first, whose housings do not hide the world from themselves.
        obstacles: what hides the world from them.
    """
    found = {}
    for i, j in pairs:
        at = min(range_m, views[i].field.reach, views[j].field.reach)
        both = [_looked_at(views[a], views[b], at, obstacles, a, b) for a, b in ((i, j), (j, i))]
        first = both[0][0] <= both[1][0] * (1 + 1e-9)
        _, own, common = both[0] if first else both[1]
        found[i, j] = common / own if own > 0 else 0.0
    return found


def weakest(found: dict[Pair, float], asked: CommonView) -> tuple[float, Pair | None]:
    """The least share that matters, and the pair that has it; (1, None) without pairs.

    Of a chain that of the links that connect all sensors best.
    """
    if asked.pairs == "chain":
        found = _links(found)
    if not found:
        return 1.0, None
    pair = min(found, key=lambda own: found[own])
    return found[pair], pair


def _links(found: dict[Pair, float]) -> dict[Pair, float]:
    """The spanning tree of the largest shares (Kruskal)."""
    group = {n: n for pair in found for n in pair}
    links = {}
    for (i, j), share in sorted(found.items(), key=lambda own: -own[1]):
        if group[i] != group[j]:
            links[i, j] = share
            old, new = group[j], group[i]
            group = {n: new if own == old else own for n, own in group.items()}
    return links


def pairs_asked(asked: CommonView, sensors: int) -> list[Pair]:
    """The pairs that have to be looked at. Raises ValueError: a rig has not so many sensors."""
    if isinstance(asked.pairs, str):
        return list(combinations(range(sensors), 2))
    most = max(max(pair) for pair in asked.pairs)
    if most >= sensors:
        raise ValueError(
            f"common_view.pairs: no sensor {most + 1}; expected 1 to {sensors}, found {most + 1}"
        )
    return list(asked.pairs)


def common_view(
    views: Sequence[View], placement: Placement, vehicle: Vehicle, asked: CommonView
) -> dict[Pair, float]:
    """`shares` of the pairs of a rig that are asked for.

    Args:
        views: of its LiDARs, and of further sensors.
        vehicle: hides the world from them, as their housings do.

    Raises:
        ValueError: as `pairs_asked`.
    """
    obstacles = obstacles_of(vehicle, housings_in(placement))
    return shares(views, pairs_asked(asked, len(views)), asked.range, obstacles)


def _looked_at(
    view: View, other: View, at: float, obstacles: Obstacles, own: int, another: int
) -> tuple[float, float, float]:
    """Solid angle of what a sensor sees, and as parts of its box of angles that and what the other
    one sees of it."""
    lowest, highest = (math.sin(end) for end in view.field.elevation)
    rows = ROWS if highest > lowest else 1
    found: NDArray[np.float64] = np.array(
        _integrate(view, other, at, obstacles, own, another, rows, STEPS)
    )
    solid = (highest - lowest) * view.field.azimuth[1] * found[0]
    return float(solid), float(found[0]), float(found[1])


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate(view, other, at, obstacles, own, another, rows, steps):
    """Parts of the box of angles of a sensor: what it sees, and what both see."""
    lowest, highest = math.sin(view.field.elevation[0]), math.sin(view.field.elevation[1])
    start, width = view.field.azimuth
    seen, common = 0.0, 0.0
    for row in range(rows):
        up = lowest + (row + 0.5) / rows * (highest - lowest)
        before = _status(view, other, at, obstacles, own, another, up, start)
        for step in range(steps):
            near, far = start + step / steps * width, start + (step + 1) / steps * width
            after = _status(view, other, at, obstacles, own, another, up, far)
            for which in range(2):
                share = 1.0 * before[which]
                if before[which] != after[which]:
                    low, high = near, far
                    for _ in range(_HALVINGS):
                        middle = 0.5 * (low + high)
                        there = _status(view, other, at, obstacles, own, another, up, middle)
                        if there[which] == before[which]:
                            low = middle
                        else:
                            high = middle
                    passed = (0.5 * (low + high) - near) / (far - near)
                    share = passed if before[which] else 1.0 - passed
                if which == 0:
                    seen += share
                else:
                    common += share
            before = after
    return seen / (rows * steps), common / (rows * steps)


@njit(cache=True, nogil=True, error_model="numpy")
def _status(view, other, at, obstacles, own, another, up, azimuth):
    """Whether a sensor sees in a direction of its own frame, and whether the other one sees the
    point there, too."""
    level = math.sqrt(max(1.0 - up * up, 0.0))
    ahead, left = level * math.cos(azimuth), level * math.sin(azimuth)
    if not has_direction(view.field, ahead, left, up):
        return False, False
    r, o = view.rotation, view.origin
    dx = r[0, 0] * ahead + r[0, 1] * left + r[0, 2] * up
    dy = r[1, 0] * ahead + r[1, 1] * left + r[1, 2] * up
    dz = r[2, 0] * ahead + r[2, 1] * left + r[2, 2] * up
    if stopped(o, dx, dy, dz, at, obstacles, own):
        return False, False
    x, y, z = o[0] + at * dx, o[1] + at * dy, o[2] + at * dz
    if not in_view(other, x, y, z):
        return True, False
    p = other.origin
    return True, not stopped(p, x - p[0], y - p[1], z - p[2], 1.0, obstacles, another)
