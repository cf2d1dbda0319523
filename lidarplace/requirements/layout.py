"""Layout of a requirement around a vehicle, the same for every rig."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle, voxels_in_body
from lidarplace.requirements.area import Positions, grid_over, in_the_way
from lidarplace.requirements.parts import FinestCells, Parts, parts_around
from lidarplace.requirements.requirement import PlacedObject, Requirement

MOST_OBJECTS = 4_000_000  # at all positions, in all headings
MOST_VOXELS = 20_000_000  # of the volume of a coverage


@dataclass(frozen=True, eq=False)
class ObjectField:
    """The objects of a requirement around one pose of the vehicle.

    Attributes:
        body: the vehicle in this pose.
        finest: finest cells in which one fits.
        parts: the parts around positions.
        boxes: the objects by heading, rows of `lidarplace.logs.boxes.GEOMETRY`; shape
            (headings, N, 7), NaN where one would be within the body."""

    body: Vehicle
    finest: FinestCells
    parts: Parts
    boxes: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RequirementLayout:
    """A requirement laid out around a vehicle; `lay_out` makes it.

    Attributes:
        requirement: what is required.
        positions: of the objects, or columns of voxels; none of a common view.
        fields: the objects by pose of the vehicle, "" the straight one; none of a coverage.
        roi: voxels of a coverage.
        phases: `roi` and others whose voxels are half an edge off along x, y or both, each with
            which columns hold the area."""

    requirement: Requirement
    positions: Positions
    fields: Mapping[str, ObjectField] = field(default_factory=dict)
    roi: Roi | None = None
    phases: tuple[tuple[Roi, NDArray[np.bool_]], ...] = ()

    @property
    def objects(self) -> int:
        """Number of the objects around the straight vehicle."""
        return int(np.isfinite(self.fields[""].boxes[:, :, 0]).sum()) if self.fields else 0

    def boxes_at(self, points: NDArray[np.float64], pose: str) -> NDArray[np.float64]:
        """Return the object at places (N, 2) by heading, NaN where it does not fit."""
        assert self.requirement.placed is not None
        straight, body = self.fields[""].body, self.fields[pose].body
        return _boxes([straight, body] if pose else [body], self.requirement.placed, points)


def lay_out(requirement: Requirement, vehicle: Vehicle) -> RequirementLayout:
    """Find the positions of a requirement.

    Raises ValueError: the area has no end, is empty, or is within the vehicle."""
    placed = requirement.placed
    if requirement.common_view is not None:
        nowhere = Positions.on_grid(np.empty(0), np.empty(0), np.empty((0, 0), np.bool_))
        return RequirementLayout(requirement, nowhere)
    if placed is None:
        return _columns(requirement, vehicle)
    grid = grid_over(requirement.area, vehicle, requirement.step)
    if len(grid.points) * placed.headings > MOST_OBJECTS:
        most = f"at most {MOST_OBJECTS:,} objects"
        number = f"{placed.headings} headings at {len(grid.points):,} positions"
        raise InputError(key="what", expected=most, found=number)
    fields: dict[str, ObjectField] = {}
    positions, numbers = grid, np.empty(0, np.intp)
    for pose, body in vehicle.poses.items():
        bodies = [vehicle.poses[""], body] if pose else [body]

        def holds(points: NDArray[np.float64], bodies: Sequence[Vehicle] = bodies) -> Any:
            held = requirement.area.holds(points[:, 0], points[:, 1], vehicle)
            held[held] = ~np.isnan(_boxes(bodies, placed, points[held])[:, :, 0]).all(axis=0)
            return held

        free = grid.held.copy()
        free[free] = holds(grid.points)
        if not free.any():
            if pose:
                continue  # a trailer that turns is there
            raise InputError("the object is inside the vehicle at each position", key="where")
        held, finest, parts = parts_around(
            Positions.on_grid(grid.x, grid.y, free), requirement.step, holds
        )
        if not pose:
            positions = Positions(grid.x, grid.y, held, parts.points)
            numbers = np.where(held, np.cumsum(held).reshape(held.shape) - 1, -1)
        parts = parts._replace(positions=numbers[held])
        parts = parts.select(parts.positions >= 0)
        fields[pose] = ObjectField(body, finest, parts, _boxes(bodies, placed, parts.points))
    return RequirementLayout(requirement, positions, fields)


def _boxes(
    bodies: Sequence[Vehicle], placed: PlacedObject, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the boxes of an object at `points` by heading, NaN for one within one of `bodies`."""
    boxes = np.stack([placed.boxes(points, angle) for angle in placed.angles.tolist()])
    for of_heading, angle in zip(boxes, placed.angles.tolist(), strict=True):
        for body in bodies:
            of_heading[in_the_way(body, points, placed.size, angle)] = np.nan
    return boxes


def _columns(requirement: Requirement, vehicle: Vehicle) -> RequirementLayout:
    """Lay out columns of voxels that hold the area, at least one along each axis."""
    step = requirement.step
    sides = (*requirement.area.sides(vehicle), requirement.heights)
    numbers = [max(1, math.ceil((high - low) / step - 1e-9)) for low, high in sides]
    if math.prod(numbers) > MOST_VOXELS:
        most, number = f"at most {MOST_VOXELS:,} voxels", f"{math.prod(numbers):,} of {step:g} m"
        raise InputError(key="step", expected=most, found=number)
    # What does not fit is spread over both sides, so that symmetry stays; the bottom stays, too.
    dx, dy, dz = (n * step - (high - low) for (low, high), n in zip(sides, numbers, strict=True))
    (x0, x1), (y0, y1), (z0, z1) = sides
    roi = Roi((x0 - dx / 2, x1 + dx / 2), (y0 - dy / 2, y1 + dy / 2), (z0, z1 + dz), step)
    x, y = roi.centres(0), roi.centres(1)
    held = requirement.area.holds(x[:, None], y[None, :], vehicle)
    if not held.any():
        raise InputError("is empty: no place is within all of its limits", key="where")
    if voxels_in_body(vehicle, roi)[held].all():
        raise InputError("is inside the vehicle", key="where")
    phases = []
    for off_x, off_y in itertools.product((0.0, 0.5 * step), repeat=2):
        (x0, x1), (y0, y1) = roi.x, roi.y
        sides = (x0 - off_x, x1 + off_x), (y0 - off_y, y1 + off_y), roi.z
        phase = Roi(*sides, step)
        columns = phase.centres(0)[:, None], phase.centres(1)[None]
        phases.append((phase, requirement.area.holds(*columns, vehicle)))
    positions = Positions.on_grid(x, y, held)
    return RequirementLayout(requirement, positions, roi=roi, phases=tuple(phases))
