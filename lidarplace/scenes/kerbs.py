"""Zones along kerbs: strips beside lanes, on no lane and in no building around a site."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from lidarplace.base.errors import InputError, at
from lidarplace.base.roi import Interval
from lidarplace.configuration.mounting import Span, number_as_interval, ordered
from lidarplace.configuration.settings import Distance, Settings, validated
from lidarplace.logs.boxes import corners
from lidarplace.scenes.kinds import Scene, obstacles_around
from lidarplace.scenes.site import Obstacles, Site
from lidarplace.scenes.sumo.buildings import Rectangles, meets_any

STEP_M = 0.5
"""Length of the pieces of which strips are made, metres."""
LEAST_PIECES = 4
"""Pieces of a strip at least."""
_Beside = Annotated[Distance, Field(gt=0)]
_OF_ONE_ZONE = ("polygon", "lidars", "mirrored")


class _KerbSettings(Settings):
    """A zone along kerbs: its distance from lanes, and where they are."""

    kerb: Annotated[
        tuple[_Beside, _Beside], BeforeValidator(number_as_interval), AfterValidator(ordered)
    ]
    x: Span
    y: Span


def with_strips(
    zones: Any,
    scene: Scene,
    site: Site,
    region: Mapping[str, Interval] | None = None,
    path: str = "",
) -> Any:
    """Return the zones of a file, plain data, with strips in place of those with the key `kerb`.

    The strips of `kerbs` are `kerbs_1`, the longest, `kerbs_2`, … `region`: x and y of zones
    without them; `path`: what is in front of names of zones in errors. Raises InputError: a value
    is wrong, no kerb is there, or a zone has the name of a strip."""
    if not isinstance(zones, Mapping):
        return zones
    expanded: dict[Any, Any] = {}
    for name, zone in zones.items():
        if not isinstance(zone, Mapping) or zone.get("kerb") is None:
            expanded[name] = zone
            continue
        place = f"{path}{name}"
        for key in _OF_ONE_ZONE:
            if key in zone:
                problem = "is of a single zone, and kerbs are several"
                raise InputError(problem, key=f"{place}.{key}", fix="remove it")
        of_kerb = {key: zone[key] for key in _KerbSettings.model_fields if key in zone}
        settings = validated(dict[str, _KerbSettings], {place: {**(region or {}), **of_kerb}}, "")[
            place
        ]
        shared = {key: value for key, value in zone.items() if key not in of_kerb}
        with at(key=f"{place}.kerb"):
            around = obstacles_around(scene, site)
        strips = _strips(around, settings.kerb, settings.x, settings.y)
        if not len(strips):
            problem = "no kerb of a lane is within x and y"
            fix = "draw polygons; the lanes of a log are unknown" * (scene.source == "log")
            raise InputError(problem, key=f"{place}.kerb", fix=fix)
        for number, polygon in enumerate(_corners(strips).tolist(), start=1):
            if (strip := f"{name}_{number}") in zones:
                problem = f"the name of a strip of {name!r}"
                raise InputError(problem, key=f"{path}{strip}", fix="rename one of them")
            expanded[strip] = shared | {"polygon": polygon}
    return expanded


def _strips(around: Obstacles, kerb: Interval, x: Interval, y: Interval) -> Rectangles:
    """Return disjoint strips beside lanes, the longest first, on no lane and in no building.

    `kerb`: least and greatest distance from the lane that a strip follows, metres; another lane may
    be nearer. They are inside of x and y, and at least 2 m long."""
    pieces, lane = _beside(around.lanes, kerb)
    x_y = _corners(pieces)
    inside = (x_y >= [x[0], y[0]]) & (x_y <= [x[1], y[1]])
    free = np.asarray(inside.all(axis=(1, 2)), bool)
    for blocked in (around.lanes, around.footprints):
        free[free] = ~meets_any(pieces[free], blocked)
    strips = []
    while free.any():
        numbers = np.flatnonzero(free)
        apart = (np.diff(numbers) > 1) | (np.diff(lane[numbers]) > 0)
        longest = max(np.split(numbers, np.flatnonzero(apart) + 1), key=len)
        if len(longest) < LEAST_PIECES:
            break
        strip = pieces[longest].mean(axis=0)
        strip[3] *= len(longest)
        strips.append(strip)
        free[longest] = False
        free[free] = ~meets_any(pieces[free], strip[None])
    return np.reshape(strips, (-1, 5))


def _beside(lanes: Rectangles, kerb: Interval) -> tuple[Rectangles, NDArray[np.int64]]:
    """Return pieces along both sides of all lanes, in order, and the number of the side of each."""
    low, high = kerb
    pieces, sides = [np.empty((0, 5))], [np.empty(0, np.int64)]
    for number, (x, y, yaw, length, width) in enumerate(lanes.tolist()):
        most = int(length / STEP_M)
        along, c, s = STEP_M * np.arange(-most, most + 1), np.cos(yaw), np.sin(yaw)
        for side in (-1, 1):
            left = side * (width + (low + high) / 2)
            piece = np.full((len(along), 5), [x, y, yaw, STEP_M / 2, (high - low) / 2])
            piece[:, 0] += c * along - s * left
            piece[:, 1] += s * along + c * left
            pieces.append(piece)
            sides.append(np.full(len(along), 2 * number + (side > 0)))
    return np.concatenate(pieces), np.concatenate(sides)


def _corners(rectangles: Rectangles) -> NDArray[np.float64]:
    """Return the corners of rectangles, anticlockwise, shape (n, 4, 2)."""
    x, y, yaw, length, width = rectangles.T
    zero = np.zeros_like(x)
    boxes = np.stack([x, y, zero, 2 * length, 2 * width, zero, yaw], axis=1)
    return corners(boxes)[:, [0, 1, 3, 2], :2]
