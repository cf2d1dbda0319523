"""How much of what one sensor sees another one sees, too: what calibration of the two needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit
from lidarplace.mounting.field_of_view import View, has_direction, in_view, view_of_sensor, views_of
from lidarplace.mounting.housing import housings_in, turned
from lidarplace.mounting.sight import Obstacles, obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.placement import Placement

ROWS, STEPS = 16, 120
"""Bands of elevation, and azimuths, at which a field of view is looked at first. Between azimuths
its edges are found by bisection, and bands are halved until they tell no more."""
_HALVINGS = 12
_TOLERANCE = 1e-3
"""Of a band: by how much its middle may differ from what its ends tell."""
Pair = tuple[int, int]


@dataclass(frozen=True)
class CommonView:
    """What pairs of sensors have to see in common.

    Attributes:
        pairs: all of them; chain: so many that each sensor is connected with each other one, over
            others; or these, numbers from 0.
        share: of the smaller field of view, less what the vehicle hides of it.
        range: at which it is looked at, metres from the sensor with the smaller one; nearer where
            one of the two does not reach so far.
    """

    pairs: Literal["all", "chain"] | tuple[Pair, ...]
    share: float
    range: float


def shares(
    views: Sequence[View], pairs: Sequence[Pair], range_m: float, obstacles: Sequence[Obstacles]
) -> dict[Pair, float]:
    """The share of the smaller field of view of each pair that both see.

    A sensor that is not there sees nothing. The smaller is the one with the smaller solid angle; of
    two that are alike the first. One of no solid angle, such as that of a single beam, is taken for
    what it goes around.

    Args:
        views: of all sensors; LiDARs first, whose housings do not hide the world from themselves.
        obstacles: what hides the world from each.
    """
    found = dict.fromkeys(pairs, 0.0)
    pairs = [pair for pair in pairs if max(pair) < len(views)]
    solid = {}
    for n in {n for pair in pairs for n in pair}:
        field = views[n].field
        box = (field.sines[1] - field.sines[0]) * field.azimuth[1]
        at = min(range_m, field.reach)
        solid[n] = box * _seen((views[n], views[n], at, obstacles[n], obstacles[n], n, n))[0]
    for i, j in pairs:
        apart = math.dist(views[i].origin, views[j].origin)
        at = min(range_m, min(views[n].field.reach for n in (i, j)) - apart)
        if at <= 0:
            continue
        first, other = (i, j) if solid[i] <= solid[j] * (1 + 1e-9) else (j, i)
        hides = obstacles[first], obstacles[other]
        own, common = _seen((views[first], views[other], at, *hides, first, other))
        found[i, j] = common / own if own > 0 else 0.0
    return found


def weakest(found: dict[Pair, float], asked: CommonView) -> tuple[float, Pair | None]:
    """The least share that matters, and the pair that has it; (1, None) without pairs. Of a chain
    that of the links that connect all sensors best."""
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
    """The pairs that have to be looked at, numbers from 0."""
    return list(combinations(range(sensors), 2) if isinstance(asked.pairs, str) else asked.pairs)


def check_pairs(asked: CommonView, sensors: int) -> None:
    """Raise ValueError if a rig has not all sensors that are named."""
    most = max(max(pair) for pair in pairs_asked(asked, sensors) or [(0, 0)])
    if most >= sensors:
        known = f"sensors from 1 to {sensors}"
        raise InputError(key="common_view.pairs", expected=known, found=most + 1)


def common_view(
    placement: Placement, vehicle: Vehicle, asked: CommonView, further: Sequence[MountedSensor] = ()
) -> dict[Pair, float]:
    """`shares` of the pairs of a rig that are asked for; numbers of `further` cameras and radars
    follow those of the LiDARs. The vehicle hides the world from all, as housings of LiDARs do."""
    housings = housings_in(placement)
    views = [*views_of(placement), *(view_of_sensor(own, own.range_of(None)) for own in further)]
    obstacles = [obstacles_of(vehicle, housings)] * len(placement.mounts)
    obstacles += [obstacles_of(vehicle, housings, own.mount.position) for own in further]
    return shares(views, pairs_asked(asked, len(views)), asked.range, obstacles)


@njit(cache=True, nogil=True, error_model="numpy")
def _seen(pair):
    """Parts of the box of angles of a sensor: what it sees, and what both of a pair see.

    `pair`: view of the sensor and of the other one, the distance, obstacles and number of each."""
    lowest, highest = pair[0].field.sines
    if highest <= lowest:
        return _of_row(pair, lowest)
    seen, common = 0.0, 0.0
    ends, rows = np.empty((_HALVINGS + 1, 2)), np.empty((_HALVINGS + 1, 4))
    for band in range(ROWS):
        ends[0, 0], ends[0, 1] = band / ROWS, (band + 1) / ROWS
        for side in range(2):
            up = lowest + ends[0, side] * (highest - lowest)
            rows[0, 2 * side], rows[0, 2 * side + 1] = _of_row(pair, up)
        depth = 0
        while depth >= 0:  # a stack of bands that are still open
            low, high = ends[depth]
            s0, c0, s1, c1 = rows[depth]
            middle = 0.5 * (low + high)
            up = lowest + middle * (highest - lowest)
            sm, cm = _of_row(pair, up)
            bent = max(abs(s0 - 2.0 * sm + s1), abs(c0 - 2.0 * cm + c1))
            if bent <= 6.0 * _TOLERANCE or depth == _HALVINGS:
                seen += (high - low) * (s0 + 4.0 * sm + s1) / 6.0
                common += (high - low) * (c0 + 4.0 * cm + c1) / 6.0
                depth -= 1
            else:
                ends[depth, 1], rows[depth, 2], rows[depth, 3] = middle, sm, cm
                depth += 1
                ends[depth, 0], ends[depth, 1] = middle, high
                rows[depth, 0], rows[depth, 1] = sm, cm
                rows[depth, 2], rows[depth, 3] = s1, c1
    return seen, common


@inner
def _of_row(pair, up):
    """The same of one elevation, whose sine is `up`."""
    start, width = pair[0].field.azimuth
    seen, common = 0.0, 0.0
    before = _status(pair, up, start)
    for step in range(STEPS):
        near, far = start + step / STEPS * width, start + (step + 1) / STEPS * width
        after = _status(pair, up, far)
        for which in range(2):
            share = 1.0 * before[which]
            if before[which] != after[which]:
                low, high = near, far
                for _ in range(_HALVINGS):
                    middle = 0.5 * (low + high)
                    if _status(pair, up, middle)[which] == before[which]:
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
    return seen / STEPS, common / STEPS


@inner
def _status(pair, up, azimuth):
    """Whether a sensor sees in a direction of its own frame, and whether the other one sees the
    point there, too."""
    view, other, at, hides, hides_other, own, another = pair
    level = math.sqrt(max(1.0 - up * up, 0.0))
    ahead, left = level * math.cos(azimuth), level * math.sin(azimuth)
    if not has_direction(view.field, ahead, left, up):
        return False, False
    o, (dx, dy, dz) = view.origin, turned(view.rotation, ahead, left, up)
    if stopped(o, dx, dy, dz, at, hides, own):
        return False, False
    x, y, z = o[0] + at * dx, o[1] + at * dy, o[2] + at * dz
    if not in_view(other, x, y, z):
        return True, False
    p = other.origin
    return True, not stopped(p, x - p[0], y - p[1], z - p[2], 1.0, hides_other, another)
