"""Parts of the ground around a vehicle, and the grid of positions over them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Interval
from lidarplace.mounting.mesh import distances
from lidarplace.mounting.slices import meets_slices, slices_of
from lidarplace.mounting.vehicle import Vehicle

_HAIR = 1e-9  # limits belong to an area, whatever rounding makes of them

MOST_POSITIONS = 1_000_000  # of one grid: a circle of 150 m at 0.25 m


@dataclass(frozen=True)
class Area:
    """A part of the ground: the points that are within all limits, metres.

    Limits belong to it. None, or no interval: not limited."""

    x: Interval | None = None
    y: tuple[Interval, ...] = ()  # one of these
    distance: Interval | None = None  # from the vehicle's body as seen from above
    sectors: tuple[Interval, ...] = ()
    """Directions from the ego frame's origin, one of these intervals of degrees from the x axis to
    the left, which may cross 180."""

    def sides(self, vehicle: Vehicle) -> tuple[Interval, Interval]:
        """Return the rectangle around the area: its x and its y, metres.

        Raises ValueError: it has no end, is empty, or has a distance from a vehicle without a
        body."""
        x = self.x or (-math.inf, math.inf)
        y = (-math.inf, math.inf)
        if self.y:
            y = (min(self.y)[0], max(high for _, high in self.y))
        if self.distance is not None:
            extents = vehicle.body.extents
            if not len(extents):
                raise InputError(key="where.distance", expected="a vehicle with a body")
            low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
            far = self.distance[1]
            x = max(x[0], low[0] - far), min(x[1], high[0] + far)
            y = max(y[0], low[1] - far), min(y[1], high[1] + far)
        if not all(map(math.isfinite, (*x, *y))):
            fix = "name a distance, or both x and y (or lanes)"
            raise InputError("has no end", key="where", fix=fix)
        if x[0] > x[1] or y[0] > y[1]:
            raise InputError("is empty: no place is within all of its limits", key="where")
        return (float(x[0]), float(x[1])), (float(y[0]), float(y[1]))

    def holds(
        self, x: NDArray[np.float64], y: NDArray[np.float64], vehicle: Vehicle
    ) -> NDArray[np.bool_]:
        """Return whether points are in the area; `x` and `y` in metres, of any one shape."""
        held = np.ones(np.broadcast(x, y).shape, np.bool_)
        if self.x is not None:
            held &= _within(x, self.x)
        if self.y:
            held &= np.any([_within(y, interval) for interval in self.y], axis=0)
        if self.distance is not None:
            held &= _within(distance_from(vehicle.body, x, y), self.distance)
        if self.sectors:
            azimuth = np.degrees(np.arctan2(y, x))
            ends = [(low - _HAIR, high + _HAIR) for low, high in self.sectors]
            held &= np.any([(azimuth - low) % 360 <= high - low for low, high in ends], axis=0)
        return held


@dataclass(frozen=True, eq=False)
class Positions:
    """A rectangular grid, and which of its points are in an area."""

    x: NDArray[np.float64]  # of its lines, metres, shape (nx,)
    y: NDArray[np.float64]  # the same, shape (ny,)
    held: NDArray[np.bool_]  # whether a point belongs to the area, shape (nx, ny)

    @property
    def points(self) -> NDArray[np.float64]:
        """Points in the area, shape (P, 2), in the order of `held`."""
        i, j = np.nonzero(self.held)
        return np.stack([self.x[i], self.y[j]], axis=1)


def grid_over(area: Area, vehicle: Vehicle, step: float) -> Positions:
    """Return points at most `step` metres apart, some on the sides of the area's rectangle.

    Raises ValueError: as `Area.sides`; more than `MOST_POSITIONS`; or the area holds none."""
    sides = area.sides(vehicle)
    numbers = [math.ceil((high - low) / step - _HAIR) + 1 for low, high in sides]
    if math.prod(numbers) > MOST_POSITIONS:
        most, number = f"at most {MOST_POSITIONS:,} positions", f"{math.prod(numbers):,}"
        raise InputError(key="step", expected=most, found=f"{number} at {step:g} m")
    x, y = (np.linspace(*side, number) for side, number in zip(sides, numbers, strict=True))
    held = area.holds(x[:, None], y[None, :], vehicle)
    if not held.any():
        raise InputError("is empty: no place is within all of its limits", key="where")
    return Positions(x, y, held)


def distance_from(
    vehicle: Vehicle, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return distances from points to the vehicle's body as seen from above, metres; 0 within."""
    away = []
    for low, high in vehicle.boxes:
        out = (
            np.maximum(np.maximum(low[i] - at, at - high[i]), 0.0) for i, at in enumerate((x, y))
        )
        away.append(np.hypot(*out))
    if vehicle.mesh is not None:
        x, y = np.broadcast_arrays(x, y)
        places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        away.append(distances(vehicle.mesh.ground_plan, places).reshape(x.shape))
    return np.asarray(np.minimum.reduce(away))


def in_the_way(
    vehicle: Vehicle, points: NDArray[np.float64], size: Sequence[float], heading: float
) -> NDArray[np.bool_]:
    """Return whether a box that stands there would be within the vehicle's body; a touch is not.

    By the theorem of the separating axis, of the body's boxes, and of what its triangles have at
    the heights of the box. Its middle is at `points`, shape (P, 2); metres and radians."""
    c, s = math.cos(heading), math.sin(heading)
    half_x = 0.5 * (abs(c) * size[0] + abs(s) * size[1])
    half_y = 0.5 * (abs(s) * size[0] + abs(c) * size[1])
    met = np.zeros(len(points), np.bool_)
    for low, high in vehicle.interior:
        if low[2] >= size[2] or high[2] <= 0.0:
            continue
        centre, half = 0.5 * (low[:2] + high[:2]), 0.5 * (high[:2] - low[:2])
        dx, dy = points[:, 0] - centre[0], points[:, 1] - centre[1]
        along = np.abs(c * dx + s * dy) < 0.5 * size[0] + abs(c) * half[0] + abs(s) * half[1]
        aside = np.abs(c * dy - s * dx) < 0.5 * size[1] + abs(s) * half[0] + abs(c) * half[1]
        met |= (np.abs(dx) < half_x + half[0]) & (np.abs(dy) < half_y + half[1]) & along & aside
    if vehicle.mesh is not None:
        free = np.flatnonzero(~met)
        slices = slices_of(vehicle.mesh.triangles, 0.0, size[2])
        met[free] = meets_slices(points[free], 0.5 * size[0], 0.5 * size[1], heading, *slices)
        free = np.flatnonzero(~met)
        middles = np.column_stack([points[free], np.full(len(free), 0.5 * size[2])])
        met[free] = vehicle.in_mesh(middles)  # all of it is inside
    return met


def _within(values: NDArray[np.float64], interval: Interval) -> NDArray[np.bool_]:
    return (values >= interval[0] - _HAIR) & (values <= interval[1] + _HAIR)
