"""Zones in which a mount may sit: a polygon seen from above, times an interval of heights."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.base.number_text import point
from lidarplace.base.roi import Interval
from lidarplace.mounting.polygon import NANOMETRE, Polygon, above_x_axis, nearest, polygon, sections

TOLERANCE = 1e-3
"""Distance outside of a zone up to which `shares` accepts a point, metres."""
_PICOMETRE = 1e-12  # gives a tip, an interval of zero width, a share of its own


@dataclass(frozen=True)
class Zone:
    """Allowed positions of a mount in the ego frame.

    Attributes:
        name: for messages.
        polygon: simple, of any orientation, convex or not: vertices (x, y), metres, rounded to a
            nanometre. A segment and a point are polygons, too.
        z: (low, high), metres; they may be equal.

    Raises:
        ValueError: no vertex, edges that cross or touch, heights the wrong way round, or a
            coordinate that is not finite."""

    name: str
    polygon: Polygon
    z: Interval

    def __post_init__(self) -> None:
        low, high = (float(height) for height in self.z)
        object.__setattr__(self, "z", (low, high))
        with at(f"zone {self.name!r}"):
            object.__setattr__(self, "polygon", polygon(self.polygon))
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InputError(key="z", expected="finite low <= high", found=f"[{low}, {high}]")

    @classmethod
    def box(cls, name: str, x: Interval, y: Interval, z: Interval) -> Zone:
        """The zone between these bounds, metres."""
        return cls(name, ((x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])), z)

    @cached_property
    def x(self) -> Interval:
        """Least and greatest x, metres."""
        xs = [x for x, _ in self.polygon]
        return min(xs), max(xs)


def position(zone: Zone, u: float, v: float, w: float) -> tuple[float, float, float]:
    """Return the point of the zone with these shares, each in [0, 1], (x, y, z) in metres.

    Onto the zone. x grows with u over the zone's length; y grows with v over its width at that x,
    without the gaps where the polygon is not convex; z grows with w."""
    if not all(0 <= share <= 1 for share in (u, v, w)):
        raise InputError("shares must be within [0, 1]", found=(u, v, w))
    x, widths = _section(zone, _between(zone.x, u))
    ends = _ends(widths)
    i = bisect_left(ends, v, lo=1) - 1
    y = _between(widths[i], (v - ends[i]) / (ends[i + 1] - ends[i]))
    return x, y, _between(zone.z, w)


def shares(zone: Zone, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the shares (u, v, w) with which `position` gives this point, up to rounding.

    0.5 where the zone has no extent. For a point outside, those of the nearest point of the zone;
    ValueError if it is more than TOLERANCE away."""
    outside = distance(zone, x, y, z)
    if not outside <= TOLERANCE:
        beyond = f"{point(x, y, z)}, {outside:.4g} m outside"
        raise InputError(place=f"zone {zone.name!r}", expected="a point of the zone", found=beyond)
    x, y = nearest(zone.polygon, _snapped(zone, x), y)
    x, widths = _section(zone, min(max(x, zone.x[0]), zone.x[1]))
    i = min(range(len(widths)), key=lambda i: max(widths[i][0] - y, y - widths[i][1]))
    ends = _ends(widths)
    v = ends[i] + _share(widths[i], y) * (ends[i + 1] - ends[i])
    if i > 0:  # at an end of two intervals `position` gives the lower one
        v = max(v, math.nextafter(ends[i], 1.0))
    return _share(zone.x, x), min(v, ends[i + 1]), _share(zone.z, z)


def distance(zone: Zone, x: float, y: float, z: float) -> float:
    """Return the distance from the point to the zone, metres; 0 for a point of it."""
    away = max(zone.z[0] - z, z - zone.z[1], 0.0)
    return math.hypot(math.dist(nearest(zone.polygon, x, y), (x, y)), away)


def grid(zone: Zone, step: float) -> NDArray[np.float64]:
    """Return candidate positions, shape (N, 3), metres, N > 0.

    Multiples of `step`, metres, from the middle: of the zone for x and z, for y of each interval
    across it at that x. So no part is too narrow for a candidate, and a zone that is symmetric to
    the plane y = 0 has symmetric candidates. Boundaries are included where they are a multiple."""
    if not (math.isfinite(step) and step > 0):
        place = f"zone {zone.name!r}"
        raise InputError(place=place, key="step", expected="a positive length", found=step)
    heights = _levels(zone.z, step)
    points = []
    for level in _levels(zone.x, step):
        x, widths = _section(zone, level)
        points += [(x, y, z) for width in widths for y in _levels(width, step) for z in heights]
    return np.array(points)


def left_half(zone: Zone) -> Zone | None:
    """Return the part with y > 0 and its boundary, or else that with y = 0; None without either.

    Raises ValueError if it is in several pieces, as no zone is that is symmetric to y = 0."""
    with at(f"zone {zone.name!r}"):
        part = above_x_axis(zone.polygon)
    return replace(zone, polygon=part) if part else on_centre_line(zone)


def on_centre_line(zone: Zone) -> Zone | None:
    """Return the part with y = 0, a zone without width; None if there is none.

    Raises ValueError as `left_half`."""
    intervals = sections(zone.polygon, 1, 0.0)
    if len(intervals) > 1:
        place, one, fix = f"zone {zone.name!r}", "one piece with y = 0", "split the zone"
        raise InputError(place=place, expected=one, found=len(intervals), fix=fix)
    return replace(zone, polygon=tuple((x, 0.0) for x in intervals[0])) if intervals else None


def _snapped(zone: Zone, x: float) -> float:
    """Return x, or that of a vertex where they differ by rounding: there the width may jump."""
    vertex = min((vertex for vertex, _ in zone.polygon), key=lambda vertex: abs(vertex - x))
    return vertex if abs(vertex - x) < 0.5 * NANOMETRE else x


def _section(zone: Zone, x: float) -> tuple[float, list[Interval]]:
    """Return the snapped x, and the intervals of y there."""
    x = _snapped(zone, x)
    return x, sections(zone.polygon, 0, x)


def _ends(widths: Sequence[Interval]) -> list[float]:
    """Return shares at which the intervals begin and end, one after the other, from 0 to 1."""
    sums = list(accumulate((high - low + _PICOMETRE for low, high in widths), initial=0.0))
    return [total / sums[-1] for total in sums]


def _between(interval: Interval, share: float) -> float:
    return min(interval[0] + share * (interval[1] - interval[0]), interval[1])


def _share(interval: Interval, value: float) -> float:
    low, high = interval
    return min(max((value - low) / (high - low), 0.0), 1.0) if low < high else 0.5


def _levels(interval: Interval, step: float) -> list[float]:
    low, high = interval
    number = math.floor(0.5 * (high - low) / step + NANOMETRE)
    centre = 0.5 * (low + high)
    return [min(max(centre + i * step, low), high) for i in range(-number, number + 1)]
