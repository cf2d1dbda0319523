"""Plain rigs of the LiDARs of another one: what a person would mount without a search."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lidarplace.mounting.zone import Zone
from sweeps.search.problem.rig import Rig, is_possible, rounded
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import Space, rig_of

Point = tuple[float, float]


def plain_rigs(space: Space, placed: Sequence[Assignment]) -> dict[str, Rig]:
    """Return rigs of the same LiDARs in the same zones: a stack, at corners, at edges.

    They point as near to level and ahead as their zones allow. Rigs that put two LiDARs in one
    place are left out."""
    rigs = {name: rig_of(_moved(placed, spots), space) for name, spots in _SPOTS.items()}
    return {name: rig for name, rig in rigs.items() if is_possible(rig)}


def _stack(zone: Zone) -> list[Point]:
    x, y = np.mean(zone.polygon, axis=0).tolist()
    return [(x, y)]


def _corners(zone: Zone) -> list[Point]:
    return [*dict.fromkeys(sorted(zone.polygon, key=lambda corner: (-corner[0], -corner[1])))]


def _edges(zone: Zone) -> list[Point]:
    corners = np.array(zone.polygon)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    return [*dict.fromkeys((x, y) for x, y in middles.tolist())]


_SPOTS: Mapping[str, Callable[[Zone], list[Point]]] = {
    "stack": _stack,
    "corners": _corners,
    "edges": _edges,
}
"""Places in a zone from above by name of the rig; further LiDARs are below the first ones."""


def _moved(
    placed: Sequence[Assignment], spots_of: Callable[[Zone], list[Point]]
) -> list[Assignment]:
    """Move each LiDAR to its place in its zone, the first ones to the zone's highest places."""
    counts, taken = Counter(one.lidar.zone for one in placed), defaultdict[str, int](int)
    moved = []
    for one in placed:
        zone = one.slot.zone(one.lidar.zone)
        spots, number = spots_of(zone), taken[zone.name]
        taken[zone.name] += 1
        levels = -(-counts[zone.name] // len(spots))
        z = np.linspace(zone.z[1], zone.z[0], levels)[number // len(spots)]
        spans = one.slot.spans[one.lidar.model]
        level = [np.clip(0.0, *spans[angle]) for angle in ("roll", "pitch")]
        angles = np.radians([*level, np.mean(spans["yaw"])]).tolist()
        mount = rounded(*spots[number % len(spots)], float(z), *angles)
        moved.append(replace(one, lidar=replace(one.lidar, mount=mount)))
    return moved
