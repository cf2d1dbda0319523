"""Layout of a requirement around a vehicle, the same for every rig."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle, voxels_in_body
from lidarplace.requirements.area import MOST_POSITIONS, Positions, grid_over, in_the_way
from lidarplace.requirements.requirement import PlacedObject, Requirement

FINEST_M = 0.05
"""Distance of positions that are not refined further, metres."""
MOST_OBJECTS = 4_000_000  # at all positions, in all headings
MOST_VOXELS = 20_000_000  # of the volume of a coverage


@dataclass(frozen=True, eq=False)
class RequirementLayout:
    """A requirement laid out around a vehicle; `lay_out` makes it.

    Attributes:
        requirement: what is required.
        vehicle: the vehicle.
        positions: of the objects, or columns of voxels; none of a common view.
        boxes: the objects by heading, rows of `lidarplace.logs.boxes.GEOMETRY`; shape
            (headings, P, 7), NaN where one would be within the body.
        roi: voxels of a coverage.
        bent: `boxes` by pose of a vehicle that bends."""

    requirement: Requirement
    vehicle: Vehicle
    positions: Positions
    boxes: NDArray[np.float64]
    roi: Roi | None
    bent: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    _fits: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    _areas: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def boxes_in(self, pose: str) -> NDArray[np.float64]:
        """Return the objects around one of the vehicle's poses, as `boxes`."""
        return self.bent.get(pose, self.boxes)

    def boxes_at(self, points: NDArray[np.float64], pose: str) -> NDArray[np.float64]:
        """Return the object at any points, as `boxes`; NaN out of the area, too."""
        placed, poses = self.requirement.placed, self.vehicle.poses
        assert placed is not None
        boxes = np.stack([placed.boxes(points, angle) for angle in placed.angles.tolist()])
        boxes[:, ~self.requirement.area.holds(points[:, 0], points[:, 1], self.vehicle)] = np.nan
        for name in {"", pose}:
            boxes = _outside(poses[name], boxes, placed, points)
        return boxes

    @property
    def levels(self) -> int:
        """Number of halvings after which positions are `FINEST_M` apart, or too many."""
        level, size = 0, self.positions.held.size
        while self.requirement.step > FINEST_M * 2**level and size * 4**level < MOST_POSITIONS / 4:
            level += 1
        return level

    def lines(self, level: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of the grid's lines, halved `level` times, metres."""
        x, y = (
            np.linspace(line[0], line[-1], (len(line) - 1) * 2**level + 1)
            for line in (self.positions.x, self.positions.y)
        )
        return x, y

    def areas_in(self, pose: str) -> NDArray[np.float64]:
        """Return the areas of the positions around one of the vehicle's poses, shape (P,)."""
        if pose not in self._areas:
            tested = self.positions.held.copy()
            tested[tested] = (~np.isnan(self.boxes_in(pose)[:, :, 0])).any(axis=0)
            self._areas[pose] = self.areas(tested, pose)[self.positions.held]
        return self._areas[pose]

    def areas(self, tested: NDArray[np.bool_], pose: str) -> NDArray[np.float64]:
        """Return how much of the area is nearest to each of the `tested` places of a halved grid.

        In cells of the grid of `positions`, shape (nx, ny)."""
        if pose not in self._fits:
            x, y = self.lines(self.levels)
            points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            portions = (points[at : at + 2**16] for at in range(0, len(points), 2**16))
            boxes = (self.boxes_at(portion, pose)[:, :, 0] for portion in portions)
            fits = np.concatenate([~np.isnan(portion).all(axis=0) for portion in boxes])
            self._fits[pose] = fits.reshape(len(x), len(y))
        fits = self._fits[pose]
        stride = max(1, (max(fits.shape) - 1) // max(max(tested.shape) - 1, 1))
        away = np.ones(fits.shape, np.bool_)
        away[::stride, ::stride] = ~tested
        nearest = distance_transform_edt(away, return_distances=False, return_indices=True)
        numbers = np.ravel_multi_index(tuple(nearest // stride), tested.shape)[fits]
        axes = sum(len(line) > 1 for line in (self.positions.x, self.positions.y))
        counts = np.bincount(numbers, minlength=tested.size) / 2.0 ** (axes * self.levels)
        return np.asarray(counts.reshape(tested.shape))

    def precision(self, pose: str) -> float:
        """Return how far off the share of the area with enough may be at the positions.

        Three standard deviations if its limits are twice as long as the sides of the grid, and
        anywhere in the cells of the positions next to them."""
        fits = (~np.isnan(self.boxes_in(pose)[:, :, 0])).any(axis=0)
        return 3.0 * math.sqrt(sum(self.positions.held.shape) / 6.0) / float(fits.sum())


def lay_out(requirement: Requirement, vehicle: Vehicle) -> RequirementLayout:
    """Find the positions of a requirement.

    Raises ValueError: the area has no end, is empty, or is within the vehicle."""
    placed = requirement.placed
    if requirement.common_view is not None:
        nowhere = Positions(np.empty(0), np.empty(0), np.empty((0, 0), np.bool_))
        return RequirementLayout(requirement, vehicle, nowhere, np.empty((0, 0, 7)), None)
    if placed is None:
        return _columns(requirement, vehicle)
    positions = grid_over(requirement.area, vehicle, requirement.step)
    points = positions.points
    if len(points) * placed.headings > MOST_OBJECTS:
        most = f"at most {MOST_OBJECTS:,} objects"
        number = f"{placed.headings} headings at {len(points):,} positions"
        raise InputError(key="what", expected=most, found=number)
    boxes = np.stack([placed.boxes(points, angle) for angle in placed.angles.tolist()])
    boxes = _outside(vehicle, boxes, placed, points)
    free = ~np.isnan(boxes[:, :, 0]).all(axis=0)
    if not free.any():
        problem = f"the object is inside {vehicle.interior_name} at each position"
        raise InputError(problem, key="where")
    held = positions.held.copy()
    held[held] = free
    boxes = boxes[:, free]
    poses = {label: pose for label, pose in vehicle.poses.items() if label}
    bent = {label: _outside(pose, boxes, placed, points[free]) for label, pose in poses.items()}
    return RequirementLayout(requirement, vehicle, replace(positions, held=held), boxes, None, bent)


def _outside(
    body: Vehicle, boxes: NDArray[np.float64], placed: PlacedObject, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the boxes of an object at `points` by heading, NaN for one within the body."""
    outside = boxes.copy()
    for of_heading, angle in zip(outside, placed.angles.tolist(), strict=True):
        of_heading[in_the_way(body, points, placed.size, angle)] = np.nan
    return outside


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
        raise InputError(f"is inside {vehicle.interior_name}", key="where")
    return RequirementLayout(requirement, vehicle, Positions(x, y, held), np.empty((0, 0, 7)), roi)
