"""Check of requirements under a rig: met if enough positions of an object have enough.

Each position counts in its worst heading, as the rig is built and in every further case that a
requirement names."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.common_view import CommonView, common_view, weakest
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Positions
from lidarplace.requirements.cameras_and_radars import measure_each
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.requirements.rays_on_objects import (
    Sight,
    at_class,
    count_cells,
    count_points,
    sights_of,
)
from lidarplace.requirements.refine import verdicts
from lidarplace.requirements.requirement import (
    AS_BUILT,
    KIND_OF,
    AlsoWhen,
    Measure,
    PlacedObject,
    Requirement,
)
from lidarplace.rigs.further_sensors import Kind, MountedSensor
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class CaseResult:
    """Result of a requirement in one case."""

    case: str  # `AS_BUILT`, a dead LiDAR, a shorter range or mounts that are off
    value: float  # what the share of positions that counts has at least; of coverage what is seen
    enough: float  # share of positions that have enough, or of pairs; of coverage what is seen
    x: float  # of the worst position, or column of voxels, metres; NaN for a common view
    y: float
    heading: float | None  # the worst there, radians; None for coverage
    at_worst: float  # what is there
    undecided: float = 0.0
    """Width of the interval of `enough` if `for` is in it; if `for` is 1, the share by which the
    least value may be lower; 0: the verdict is sure."""
    refined: bool = False  # whether it takes more than the positions of the layout


@dataclass(frozen=True, eq=False)
class RequirementResult:
    """Result of a requirement under one rig."""

    rig: str
    requirement: Requirement
    cases: tuple[CaseResult, ...]  # as built first
    positions: Positions
    least_of: NDArray[np.float64]  # of every position the least of all cases, shape (P,)

    @property
    def worst(self) -> CaseResult:
        """The case with the least value, sure failures before others; of equal ones the first."""
        return min(self.cases, key=lambda case: (self.may_pass(case), case.value))

    def may_pass(self, case: CaseResult) -> bool:
        """Return whether a case has enough, or may have."""
        return case.undecided > 0 or case.value >= self.requirement.least

    @property
    def met(self) -> bool:
        """Whether all cases surely have enough."""
        return self.worst.value >= self.requirement.least


class _Case(NamedTuple):
    """A requirement around a pose of the vehicle, under a rig in some state.

    `kinds` and `names` are of the sensors that count, those of LiDARs first; `working` has by label
    the numbers of those that work, first "" with all of them."""

    layout: RequirementLayout
    pose: str
    rig: Placement
    vehicle: Vehicle
    further: Sequence[MountedSensor]
    sights: Callable[[], list[Sight]]
    kinds: list[Kind]
    names: list[str]
    working: Mapping[str, Sequence[int]]


NEAR_SHARE = 0.05
"""Distance of a coverage from its limit below which phases of the voxels are compared."""

_Measured = tuple[str, CaseResult, NDArray[np.float64]]
"""Name of a case, "" for the rig as it is, its result, and the value of every position."""


def check_requirements(
    layouts: Sequence[RequirementLayout],
    placement: Placement,
    vehicle: Vehicle,
    further: Sequence[MountedSensor] = (),
) -> list[RequirementResult]:
    """Check requirements that are laid out around `vehicle` under one rig.

    Dead LiDARs cost little: what a rig has without them follows from the counts of all. A LiDAR
    inside of the vehicle's body sees nothing. Cameras and radars, `further`, are as built."""

    @cache
    def sights_once(rig: Placement, pose: str) -> list[Sight]:
        return sights_of(rig, vehicle.poses[pose])

    results = []
    for layout in layouts:
        requirement, cases = layout.requirement, []
        least = np.full(int(layout.positions.held.sum()), np.inf)
        variants = requirement.also_when.variants(placement).items()
        for (pose, body), (variant, rig) in itertools.product(vehicle.poses.items(), variants):
            kinds, names = _counting(requirement, rig, further)
            also = requirement.also_when if variant == AS_BUILT else AlsoWhen()
            working = also.left(names, kinds.count("lidar"))
            sights = partial(sights_once, rig, pose)
            case = _Case(layout, pose, rig, body, further, sights, kinds, names, working)
            if requirement.common_view is not None:
                measured = _of_pairs(case, requirement.common_view)
            elif layout.roi is None:
                measured = _of_objects(case)
            else:
                measured = _of_volume(case, layout.roi)
            for label, result, values in measured:
                name = label or variant
                if pose:
                    name = pose if name == AS_BUILT else f"{pose}, {name}"
                cases.append(replace(result, case=name))
                least = np.fmin(least, values)
        results.append(
            RequirementResult(placement.name, requirement, tuple(cases), layout.positions, least)
        )
    return results


def _counting(
    requirement: Requirement, rig: Placement, further: Sequence[MountedSensor]
) -> tuple[list[Kind], list[str]]:
    """Return kinds and names of the sensors that count, in the order of columns of `_of_each`."""
    kinds: list[Kind] = []
    names: list[str] = []
    for measure, _ in requirement.needs or ((requirement.measure, requirement.least),):
        kind = KIND_OF.get(measure, "lidar")
        if kind == "lidar":
            names += [f"LiDAR {number + 1}" for number in range(len(rig.mounts))]
        else:
            names += [sensor.name for sensor in further if sensor.kind == kind]
        kinds += [kind] * (len(names) - len(kinds))
    return kinds, names


def _of_objects(case: _Case) -> Iterator[_Measured]:
    """Measure all LiDARs together; or several sensors, cameras and radars, each by itself."""
    requirement, working = case.layout.requirement, [*case.working.values()]
    sensors, kinds = requirement.sensors, requirement.kinds
    if np.isnan(case.layout.boxes_in(case.pose)[:, :, 0]).all():
        return  # a trailer that turns is there

    def measure(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        if sensors is None:
            return _of_lidars(case, requirement.measure, boxes, working)
        each = _of_each(case, boxes)
        columns = [by_several(each, case.kinds, numbers, sensors, kinds) for numbers in working]
        return np.stack(columns, axis=1)

    results, values = verdicts(case.layout, case.pose, measure)
    for label, verdict, column in zip(case.working, results, values.T, strict=True):
        (x, y, heading, least), undecided = verdict.worst, verdict.undecided
        result = CaseResult("", verdict.value, verdict.enough, x, y, heading, least, undecided)
        yield label, replace(result, refined=verdict.refined), column


def _placed(case: _Case) -> PlacedObject:
    assert case.layout.requirement.placed is not None
    return case.layout.requirement.placed


def _of_lidars(
    case: _Case, measure: Measure, boxes: NDArray[np.float64], sets: Sequence[Sequence[int]]
) -> NDArray[np.float64]:
    """Measure the LiDARs of each set together, shape (B, sets)."""
    requirement, placed = case.layout.requirement, _placed(case)
    sights, light = at_class(case.sights(), case.rig, placed.object_class), placed.reflectivity
    if measure == "points":
        return count_points(sights, boxes, light, sets)
    cells = count_cells(sights, boxes, requirement.cell, light, sets)
    return requirement.curve.probability(cells) if requirement.curve else cells


def _of_each(case: _Case, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure each sensor as a multiple of what it needs, shape (B, sensors)."""
    requirement, columns = case.layout.requirement, []
    for measure, need in requirement.needs or ((requirement.measure, 1.0),):
        if measure in KIND_OF:
            sensors = [sensor for sensor in case.further if sensor.kind == KIND_OF[measure]]
            object_class = _placed(case).object_class
            values = measure_each(sensors, boxes, object_class, case.rig, case.vehicle)
        else:
            alone = [(number,) for number in range(len(case.rig.mounts))]
            values = _of_lidars(case, measure, boxes, alone)
        columns.append(values / need)
    return np.concatenate(columns, axis=1)


def by_several(
    each: NDArray[np.float64], kinds: Sequence[str], numbers: Sequence[int], sensors: int, of: int
) -> NDArray[np.float64]:
    """Return what `sensors` sensors of at least `of` kinds have, each by itself, shape (B,).

    0 where there are fewer. `each` has a column for every sensor, shape (B, sensors); those whose
    `numbers` are named count."""
    values = _nth_largest(each[:, numbers], sensors)
    if of > 1:
        counting = sorted({kinds[number] for number in numbers})
        best = [each[:, [n for n in numbers if kinds[n] == k]].max(axis=1) for k in counting]
        several = np.stack(best, axis=1) if best else np.empty((len(each), 0))
        values = np.minimum(values, _nth_largest(several, of))
    return values


def _nth_largest(values: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Return the nth largest number of each row; 0 where it has fewer numbers."""
    if values.shape[1] < n:
        return np.zeros(len(values))
    return np.asarray(np.partition(values, -n, axis=1)[:, -n])


def _of_pairs(case: _Case, view: CommonView) -> Iterator[_Measured]:
    names = [f"LiDAR {number + 1}" for number in range(len(case.rig.mounts))]
    names += [sensor.name for sensor in case.further]
    shares = common_view(case.rig, case.vehicle, view, case.further)
    share, pair = weakest(shares, view)
    least = case.layout.requirement.least
    enough = float(np.mean([value >= least for value in shares.values()])) if shares else 1.0
    label = " and ".join(names[n] if n < len(names) else "none" for n in pair or ())
    yield label, CaseResult("", share, enough, math.nan, math.nan, None, share), np.empty(0)


def _of_volume(case: _Case, roi: Roi) -> Iterator[_Measured]:
    layout, sensors = case.layout, case.layout.requirement.sensors or 1
    sets, least = [*case.working.values()], layout.requirement.least
    every, outside = seen_in_columns(case.rig, case.vehicle, roi, sets, sensors)
    outside = outside[layout.positions.held]
    if not outside.any():
        return  # a trailer that turns is there
    for number, (label, layer) in enumerate(zip(case.working, every, strict=True)):
        seen = layer[layout.positions.held]
        shares = np.divide(seen, outside, out=np.full(len(seen), np.inf), where=outside > 0)
        worst = int(shares.argmin())
        x, y = layout.positions.points[worst].tolist()
        share, undecided = int(seen.sum()) / int(outside.sum()), 0.0
        if abs(share - least) < NEAR_SHARE:
            low, high = _over_phases(case, roi, share, sets[number])
            if low < least - 1e-9 <= high:
                share, undecided = low, high - low
        at_worst = float(shares[worst])
        yield label, CaseResult("", share, share, x, y, None, at_worst, undecided), shares


def _over_phases(case: _Case, roi: Roi, share: float, lidars: Sequence[int]) -> tuple[float, float]:
    """Return an interval of the share that LiDARs see, over phases of the voxels.

    Those half an edge away along x, y or both see other shares; the interval is twice as wide."""
    requirement, half, shares = case.layout.requirement, 0.5 * roi.resolution, [share]
    for dx, dy in ((0.0, half), (half, 0.0), (half, half)):
        (x0, x1), (y0, y1) = roi.x, roi.y
        phase = Roi((x0 - dx, x1 + dx), (y0 - dy, y1 + dy), roi.z, roi.resolution)
        held = requirement.area.holds(
            phase.centres(0)[:, None], phase.centres(1)[None], case.layout.vehicle
        )
        sensors = requirement.sensors or 1
        (seen,), outside = seen_in_columns(case.rig, case.vehicle, phase, [lidars], sensors)
        shares.append(seen[held].sum() / outside[held].sum())
    spread = 0.5 * (max(shares) - min(shares))
    return float(min(shares) - spread), float(max(shares) + spread)
