"""What becomes of requirements under a rig: met if enough positions of an object, each in its worst
heading, have enough, as the rig is built and in every case that a requirement names besides."""

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
from lidarplace.requirements.cameras_and_radars import seen_by_each
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.requirements.rays_on_objects import (
    Sight,
    at_class,
    count_cells,
    count_points,
    sights_of,
)
from lidarplace.requirements.requirement import (
    AS_BUILT,
    KIND_OF,
    AlsoWhen,
    Measure,
    Requirement,
    may_fail,
)
from lidarplace.rigs.further_sensors import Kind, MountedSensor
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class CaseResult:
    """What a requirement finds in one case."""

    case: str  # `AS_BUILT`, a dead LiDAR, a shorter range or mounts that are off
    value: float  # what the share of positions that counts has at least; of coverage what is seen
    enough: float  # share of positions that have enough, or of pairs; of coverage what is seen
    x: float  # of the worst position, or column of voxels, metres; NaN for a common view
    y: float
    heading: float | None  # the worst there, radians; None for coverage
    at_worst: float  # what is there


@dataclass(frozen=True, eq=False)
class RequirementResult:
    """A requirement under one rig."""

    rig: str
    requirement: Requirement
    findings: tuple[CaseResult, ...]  # as built first
    positions: Positions
    least_of: NDArray[np.float64]  # of every position the least of all cases, shape (P,)

    @property
    def worst(self) -> CaseResult:
        """The case with the least value; of equal ones the first."""
        return min(self.findings, key=lambda finding: finding.value)

    @property
    def met(self) -> bool:
        """Whether all cases have enough."""
        return self.worst.value >= self.requirement.least


class _Case(NamedTuple):
    """A requirement around a pose of the vehicle, under a rig in some state.

    `kinds` and `names` are of the sensors that count, those of LiDARs first; `left` has by label
    the numbers of those that work, first "" with all of them."""

    own: RequirementLayout
    rig: Placement
    vehicle: Vehicle
    further: Sequence[MountedSensor]
    sights: Callable[[], list[Sight]]
    kinds: list[Kind]
    names: list[str]
    left: Mapping[str, Sequence[int]]


def check_requirements(
    laid: Sequence[RequirementLayout],
    placement: Placement,
    vehicle: Vehicle,
    further: Sequence[MountedSensor] = (),
) -> list[RequirementResult]:
    """What becomes of requirements that are laid out around `vehicle` under one rig. LiDARs that
    are dead cost little: what a rig has without them follows from the counts of all. One inside of
    the vehicle's body sees nothing. Cameras and radars, `further`, are as built."""

    @cache
    def sights_once(rig: Placement, pose: str) -> list[Sight]:
        return sights_of(rig, vehicle.poses[pose])

    outcomes = []
    for own in laid:
        wanted, findings = own.requirement, []
        least = np.full(int(own.positions.held.sum()), np.inf)
        variants = wanted.also_when.variants(placement).items()
        for (pose, body), (case, rig) in itertools.product(vehicle.poses.items(), variants):
            around = replace(own, boxes=own.boxes_in(pose))
            kinds, names = _counting(wanted, rig, further)
            also = wanted.also_when if case == AS_BUILT else AlsoWhen()
            left = also.left(names, kinds.count("lidar"))
            seeing = partial(sights_once, rig, pose)
            found = _Case(around, rig, body, further, seeing, kinds, names, left)
            if wanted.common_view is not None:
                values = _of_pairs(found, wanted.common_view)
            else:
                values = _of_objects(found) if own.roi is None else _of_volume(found, own.roi)
            for label, finding, shown in values:
                named = label or case
                if pose:
                    named = pose if named == AS_BUILT else f"{pose}, {named}"
                findings.append(replace(finding, case=named))
                least = np.fmin(least, shown)
        outcomes.append(
            RequirementResult(placement.name, wanted, tuple(findings), own.positions, least)
        )
    return outcomes


Found = tuple[str, CaseResult, NDArray[np.float64]]
"""Name of a case, "" for the rig as it is, what was found, and what every position has."""


def _counting(
    wanted: Requirement, rig: Placement, further: Sequence[MountedSensor]
) -> tuple[list[Kind], list[str]]:
    """Kinds and names of the sensors that count, in the order of the columns of `_of_each`."""
    kinds: list[Kind] = []
    names: list[str] = []
    for measure, _ in wanted.needs or ((wanted.measure, wanted.least),):
        kind = KIND_OF.get(measure, "lidar")
        if kind == "lidar":
            names += [f"LiDAR {number + 1}" for number in range(len(rig.mounts))]
        else:
            names += [own.name for own in further if own.kind == kind]
        kinds += [kind] * (len(names) - len(kinds))
    return kinds, names


def _of_objects(case: _Case) -> Iterator[Found]:
    """What all LiDARs have together; or several sensors, cameras and radars, each by itself."""
    own, wanted, placed = case.own, case.own.requirement, case.own.requirement.placed
    there = ~np.isnan(own.boxes[:, :, 0])
    assert placed is not None
    if not there.any():
        return
    boxes, left = own.boxes[there], [*case.left.values()]
    if wanted.sensors is None:
        found = [*_of_lidars(case, wanted.measure, boxes, left).T]
    else:
        each = _of_each(case, boxes)
        found = [by_several(each, case.kinds, n, wanted.sensors, wanted.kinds) for n in left]
    for label, has in zip(case.left, found, strict=True):
        by_heading = np.full(there.shape, np.inf)
        by_heading[there] = has
        values = by_heading.min(axis=0)
        free = values[np.isfinite(values)]  # a trailer that turns may stand where others might
        worst = int(values.argmin())
        x, y = own.positions.points[worst].tolist()
        value = float(np.sort(free)[may_fail(wanted.share, len(free))])
        enough = float((free >= wanted.least).mean())
        heading = float(placed.angles[by_heading[:, worst].argmin()])
        yield label, CaseResult("", value, enough, x, y, heading, float(values[worst])), values


def _of_lidars(
    case: _Case, measure: Measure, boxes: NDArray[np.float64], sets: Sequence[Sequence[int]]
) -> NDArray[np.float64]:
    """What LiDARs of each set have together, shape (B, sets)."""
    wanted, placed = case.own.requirement, case.own.requirement.placed
    assert placed is not None
    sights, light = at_class(case.sights(), case.rig, placed.object_class), placed.reflectivity
    if measure == "points":
        return count_points(sights, boxes, light, sets)
    found = count_cells(sights, boxes, wanted.cell, light, sets)
    return wanted.curve.probability(found) if wanted.curve else found


def _of_each(case: _Case, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each sensor has of what it needs, shape (B, sensors)."""
    wanted, columns = case.own.requirement, []
    assert wanted.placed is not None
    for measure, need in wanted.needs or ((wanted.measure, 1.0),):
        if measure in KIND_OF:
            some = [sensor for sensor in case.further if sensor.kind == KIND_OF[measure]]
            kind = wanted.placed.object_class
            found = seen_by_each(some, boxes, kind, case.rig, case.vehicle)
        else:
            each = [(number,) for number in range(len(case.rig.mounts))]
            found = _of_lidars(case, measure, boxes, each)
        columns.append(found / need)
    return np.concatenate(columns, axis=1)


def by_several(
    each: NDArray[np.float64], kinds: Sequence[str], left: Sequence[int], sensors: int, of: int
) -> NDArray[np.float64]:
    """What so many sensors of at least `of` kinds have, each by itself; 0 where there are fewer.
    `each` has a column for every sensor, shape (B, sensors); those whose numbers are `left`
    count."""
    found = _nth_largest(each[:, left], sensors)
    if of > 1:
        there = sorted({kinds[number] for number in left})
        best = [each[:, [n for n in left if kinds[n] == kind]].max(axis=1) for kind in there]
        several = np.stack(best, axis=1) if best else np.empty((len(each), 0))
        found = np.minimum(found, _nth_largest(several, of))
    return found


def _nth_largest(values: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Of each row; 0 where it has fewer numbers."""
    if values.shape[1] < n:
        return np.zeros(len(values))
    return np.asarray(np.partition(values, -n, axis=1)[:, -n])


def _of_pairs(case: _Case, asked: CommonView) -> Iterator[Found]:
    names = [f"LiDAR {number + 1}" for number in range(len(case.rig.mounts))]
    names += [sensor.name for sensor in case.further]
    found = common_view(case.rig, case.vehicle, asked, case.further)
    share, pair = weakest(found, asked)
    least = case.own.requirement.least
    enough = float(np.mean([own >= least for own in found.values()])) if found else 1.0
    label = " and ".join(names[n] if n < len(names) else "none" for n in pair or ())
    yield label, CaseResult("", share, enough, math.nan, math.nan, None, share), np.empty(0)


def _of_volume(case: _Case, roi: Roi) -> Iterator[Found]:
    own, sensors = case.own, case.own.requirement.sensors or 1
    sets = [*case.left.values()]
    every, outside = seen_in_columns(case.rig, case.vehicle, roi, sets, sensors)
    outside = outside[own.positions.held]
    if not outside.any():
        return  # a trailer that turns is there
    for label, layer in zip(case.left, every, strict=True):
        seen = layer[own.positions.held]
        shares = np.divide(seen, outside, out=np.full(len(seen), np.inf), where=outside > 0)
        worst = int(shares.argmin())
        x, y = own.positions.points[worst].tolist()
        share = int(seen.sum()) / int(outside.sum())
        yield label, CaseResult("", share, share, x, y, None, float(shares[worst])), shares
