"""Field of view that two sensors have in common, as their calibration needs it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from lidarplace.base.errors import InputError
from lidarplace.mounting.field_of_view import View, view_of_sensor, views_of
from lidarplace.mounting.housing import housings_in
from lidarplace.mounting.sight import Obstacles, obstacles_of
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.mounting.view_edges import Edges, edges_of
from lidarplace.mounting.view_share import seen_parts, steps_between_edges
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.placement import Placement

Pair = tuple[int, int]


@dataclass(frozen=True)
class CommonView:
    """A field of view that pairs of sensors must have in common.

    Attributes:
        pairs: all of them; chain: enough to connect each sensor with each other one, over others;
            or these, numbers from 0.
        share: of the smaller field of view, less what the vehicle hides of it.
        range: distance at which views are compared, metres from the sensor with the smaller one;
            nearer where one of the two does not reach so far."""

    pairs: Literal["all", "chain"] | tuple[Pair, ...]
    share: float
    range: float


def shares(
    views: Sequence[View], pairs: Sequence[Pair], range_m: float, obstacles: Sequence[Obstacles]
) -> dict[Pair, float]:
    """Return the share of the smaller field of view of each pair that both see.

    A sensor that is missing sees nothing. The smaller is the one with the smaller solid angle; of
    two that are alike the first. One of no solid angle, such as that of a single beam, is taken for
    what it goes around.

    Args:
        views: of all sensors; LiDARs first, whose housings do not hide the world from themselves.
        pairs: numbers of the sensors.
        range_m: see `CommonView.range`.
        obstacles: what hides the world from each."""
    common_shares = dict.fromkeys(pairs, 0.0)
    pairs = [pair for pair in pairs if max(pair) < len(views)]
    solid: dict[int, float] = {}
    edges: dict[int, Edges] = {}

    def parts(one: int, other: int, at: float) -> tuple[float, float]:
        hides, ends = (obstacles[one], obstacles[other]), (edges[one], edges[other])
        steps = steps_between_edges(hides)
        seen, common = seen_parts((views[one], views[other], at, *hides, one, other, *ends, steps))
        return seen, common

    for n in {n for pair in pairs for n in pair}:
        edges[n] = edges_of(views[n], obstacles[n], n)
        field = views[n].field
        box = (field.sines[1] - field.sines[0]) * field.azimuth[1]
        at = min(range_m, field.reach)
        solid[n] = box * parts(n, n, at)[0]
    for i, j in pairs:
        apart = math.dist(views[i].origin, views[j].origin)
        at = min(range_m, min(views[n].field.reach for n in (i, j)) - apart)
        if at <= 0:
            continue
        first, other = (i, j) if solid[i] <= solid[j] * (1 + 1e-9) else (j, i)
        whole, common = parts(first, other, at)
        common_shares[i, j] = common / whole if whole > 0 else 0.0
    return common_shares


def weakest(view_shares: dict[Pair, float], view: CommonView) -> tuple[float, Pair | None]:
    """Return the least share that matters, and the pair that has it; (1, None) without pairs.

    In a chain it is that of the links that connect all sensors best."""
    if view.pairs == "chain":
        view_shares = _links(view_shares)
    if not view_shares:
        return 1.0, None
    pair = min(view_shares, key=lambda pair: view_shares[pair])
    return view_shares[pair], pair


def _links(view_shares: dict[Pair, float]) -> dict[Pair, float]:
    """Return the spanning tree of the largest shares (Kruskal)."""
    group = {n: n for pair in view_shares for n in pair}
    links = {}
    for (i, j), share in sorted(view_shares.items(), key=lambda item: -item[1]):
        if group[i] != group[j]:
            links[i, j] = share
            old, new = group[j], group[i]
            group = {n: new if label == old else label for n, label in group.items()}
    return links


def pairs_to_compare(view: CommonView, sensors: int) -> list[Pair]:
    """Return the pairs to compare, numbers from 0."""
    return list(combinations(range(sensors), 2) if isinstance(view.pairs, str) else view.pairs)


def check_pairs(view: CommonView, sensors: int) -> None:
    """Raise ValueError if a rig lacks a sensor that is named."""
    most = max(max(pair) for pair in pairs_to_compare(view, sensors) or [(0, 0)])
    if most >= sensors:
        sensor_numbers = f"sensors from 1 to {sensors}"
        raise InputError(key="common_view.pairs", expected=sensor_numbers, found=most + 1)


def common_view(
    placement: Placement, vehicle: Vehicle, view: CommonView, further: Sequence[MountedSensor] = ()
) -> dict[Pair, float]:
    """Return `shares` of the pairs of a rig that are to be compared.

    Numbers of `further` cameras and radars follow those of the LiDARs. The vehicle hides the world
    from all, as housings of LiDARs do."""
    housings = housings_in(placement)
    views = [
        *views_of(placement),
        *(view_of_sensor(sensor, sensor.range_of(None)) for sensor in further),
    ]
    obstacles = [obstacles_of(vehicle, housings)] * len(placement.mounts)
    obstacles += [obstacles_of(vehicle, housings, sensor.mount.position) for sensor in further]
    return shares(views, pairs_to_compare(view, len(views)), view.range, obstacles)
