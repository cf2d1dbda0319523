"""What becomes of requirements under a rig.

An object is placed at every position of a grid, in the worst of several headings. A requirement is
met if enough positions have enough, as the rig is built and in every case that it names besides.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.common_view import CommonView, common_view, weakest
from lidarplace.mounting.near_field import seen_without
from lidarplace.mounting.vehicle import Vehicle, poses_of
from lidarplace.requirements.area import Positions
from lidarplace.requirements.cameras_and_radars import seen_by_each
from lidarplace.requirements.layout import Laid
from lidarplace.requirements.rays_on_objects import (
    Counts,
    Sight,
    at_class,
    count_cells,
    count_points,
    sights_of,
)
from lidarplace.requirements.requirement import AS_BUILT, KIND_OF, Measure, Requirement, may_fail
from lidarplace.rigs.further_sensors import Kind, MountedSensor
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class Finding:
    """What a requirement finds in one case.

    Attributes:
        case: `AS_BUILT`, a dead LiDAR, a shorter range or mounts that are off.
        value: what the share of positions that counts has at least; of coverage the share seen.
        enough: share of the positions that have enough, or of pairs; of coverage the share seen.
        x, y: the worst position, or column of voxels, metres; NaN for a common view.
        heading: the worst there, radians; None for coverage.
        at_worst: what is there.
    """

    case: str
    value: float
    enough: float
    x: float
    y: float
    heading: float | None
    at_worst: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """A requirement under one rig.

    Attributes:
        rig: name.
        requirement: the one that was asked.
        findings: as built first.
        positions: where it was looked.
        least_of: of every position the least of all cases, float64, shape (P,).
    """

    rig: str
    requirement: Requirement
    findings: tuple[Finding, ...]
    positions: Positions
    least_of: NDArray[np.float64]

    @property
    def worst(self) -> Finding:
        """The case with the least value; of equal ones the first."""
        return min(self.findings, key=lambda finding: finding.value)

    @property
    def met(self) -> bool:
        """Whether all cases have enough."""
        return self.worst.value >= self.requirement.least


def judge(
    laid: Sequence[Laid],
    placement: Placement,
    vehicle: Vehicle,
    further: Sequence[MountedSensor] = (),
) -> list[Outcome]:
    """What becomes of requirements that are laid out around `vehicle` under one rig.

    LiDARs that are dead cost little: what a rig has without them follows from the counts of all.
    One inside of the vehicle's body sees nothing.

    Args:
        further: cameras and radars of the rig, which are always as built.
    """
    sights: dict[tuple[Placement, str], list[Sight]] = {}

    def sights_once(rig: Placement, pose: str) -> list[Sight]:
        if (rig, pose) not in sights:
            sights[rig, pose] = sights_of(rig, poses_of(vehicle)[pose])
        return sights[rig, pose]

    outcomes = []
    for own in laid:
        findings, least = [], np.full(int(own.positions.held.sum()), np.inf)
        variants = own.requirement.also_when.variants(placement).items()
        for (pose, body), (case, rig) in itertools.product(poses_of(vehicle).items(), variants):
            around = replace(own, boxes=own.boxes_in(pose))
            dead: dict[str, tuple[int, ...]] = {"": ()}
            if case == AS_BUILT:
                kinds, names = _counting(own.requirement, rig, further)
                dead = own.requirement.also_when.dead(names, kinds.count("lidar"))
            if own.requirement.common_view is not None:
                asked = own.requirement.common_view
                values = _of_pairs(own.requirement, asked, rig, body, further)
            elif own.requirement.sensors is not None and own.roi is None:
                seeing = partial(sights_once, rig, pose)
                values = _of_each(around, seeing, rig, body, further, dead)
            elif own.roi is None:
                values = _of_objects(around, sights_once(rig, pose), rig, dead)
            else:
                values = _of_volume(own, own.roi, rig, body, dead)
            for label, finding, shown in values:
                named = label or case
                if pose:
                    named = pose if named == AS_BUILT else f"{pose}, {named}"
                findings.append(replace(finding, case=named))
                least = np.fmin(least, shown)
        outcomes.append(
            Outcome(placement.name, own.requirement, tuple(findings), own.positions, least)
        )
    return outcomes


Found = tuple[str, Finding, NDArray[np.float64]]
"""Name of a case, "" for the rig as it is, what was found, and what every position has."""


def _of_objects(
    own: Laid, sights: list[Sight], rig: Placement, dead: Mapping[str, tuple[int, ...]]
) -> Iterator[Found]:
    wanted = own.requirement
    there = ~np.isnan(own.boxes[:, :, 0])
    if not there.any():
        return
    counts = _counts(wanted, wanted.measure, sights, rig, own.boxes[there], [*dead.values()])
    for number, label in enumerate(dead):
        by_heading = np.full(there.shape, np.inf)
        left = counts.left[:, number]
        by_heading[there] = wanted.curve.probability(left) if wanted.curve else left
        yield label, *_worst_heading(own, by_heading)


def _counts(
    wanted: Requirement,
    measure: Measure,
    sights: list[Sight],
    rig: Placement,
    boxes: NDArray[np.float64],
    dead: Sequence[tuple[int, ...]] = (),
) -> Counts:
    assert wanted.placed is not None
    sights, light = at_class(sights, rig, wanted.placed.object_class), wanted.placed.reflectivity
    if measure == "points":
        return count_points(sights, boxes, light, dead)
    return count_cells(sights, boxes, wanted.cell, light, dead)


def _counting(
    wanted: Requirement, rig: Placement, further: Sequence[MountedSensor]
) -> tuple[list[Kind], list[str]]:
    """Kinds and names of the sensors that count, in the order of the columns of `_of_each`."""
    kinds: list[Kind] = []
    names = []
    for measure, _ in wanted.needs or ((wanted.measure, wanted.least),):
        kind = KIND_OF.get(measure, "lidar")
        if kind == "lidar":
            names += [f"LiDAR {number + 1}" for number in range(len(rig.mounts))]
        else:
            names += [own.name for own in further if own.kind == kind]
        kinds += [kind] * (len(names) - len(kinds))
    return kinds, names


def _of_each(
    own: Laid,
    sights: Callable[[], list[Sight]],
    rig: Placement,
    vehicle: Vehicle,
    further: Sequence[MountedSensor],
    dead: Mapping[str, tuple[int, ...]],
) -> Iterator[Found]:
    """What several sensors have, each by itself, cameras and radars among them."""
    wanted, placed = own.requirement, own.requirement.placed
    assert placed is not None
    assert wanted.sensors is not None
    there = ~np.isnan(own.boxes[:, :, 0])
    if not there.any():
        return
    boxes, columns = own.boxes[there], []
    for measure, need in wanted.needs or ((wanted.measure, 1.0),):
        if measure in KIND_OF:
            some = [sensor for sensor in further if sensor.kind == KIND_OF[measure]]
            found = seen_by_each(some, boxes, placed.object_class, rig, vehicle)
        else:
            found = _counts(wanted, measure, sights(), rig, boxes).each
            found = wanted.curve.probability(found) if wanted.curve else found
        columns.append(found / need)
    each, (kinds, _) = np.concatenate(columns, axis=1), _counting(wanted, rig, further)
    for label, without in dead.items():
        by_heading = np.full(there.shape, np.inf)
        by_heading[there] = by_several(each, kinds, without, wanted.sensors, wanted.kinds)
        yield label, *_worst_heading(own, by_heading)


def by_several(
    each: NDArray[np.float64], kinds: Sequence[str], dead: Sequence[int], sensors: int, of: int
) -> NDArray[np.float64]:
    """What so many sensors have at least, each by itself; 0 where there are fewer.

    Args:
        each: of every sensor, shape (B, sensors).
        kinds: of every sensor.
        dead: numbers of sensors that do not count.
        of: of so many kinds they have to be.
    """
    alive = [number for number in range(len(kinds)) if number not in dead]
    found = _nth_largest(each[:, alive], sensors)
    if of > 1:
        there = sorted({kinds[number] for number in alive})
        best = [each[:, [n for n in alive if kinds[n] == kind]].max(axis=1) for kind in there]
        several = np.stack(best, axis=1) if best else np.empty((len(each), 0))
        found = np.minimum(found, _nth_largest(several, of))
    return found


def _nth_largest(values: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Of each row; 0 where it has fewer numbers."""
    if values.shape[1] < n:
        return np.zeros(len(values))
    return np.asarray(np.partition(values, -n, axis=1)[:, -n])


def _worst_heading(
    own: Laid, by_heading: NDArray[np.float64]
) -> tuple[Finding, NDArray[np.float64]]:
    wanted, placed = own.requirement, own.requirement.placed
    assert placed is not None
    values = by_heading.min(axis=0)
    free = values[np.isfinite(values)]  # a trailer that turns may stand where others might
    worst = int(values.argmin())
    x, y = own.positions.points[worst].tolist()
    finding = Finding(
        case="",
        value=float(np.sort(free)[may_fail(wanted.share, len(free))]),
        enough=float((free >= wanted.least).mean()),
        x=x,
        y=y,
        heading=float(placed.angles[by_heading[:, worst].argmin()]),
        at_worst=float(values[worst]),
    )
    return finding, values


def _of_pairs(
    wanted: Requirement,
    asked: CommonView,
    rig: Placement,
    vehicle: Vehicle,
    further: Sequence[MountedSensor],
) -> Iterator[Found]:
    names = [f"LiDAR {number + 1}" for number in range(len(rig.mounts))]
    names += [sensor.name for sensor in further]
    found = common_view(rig, vehicle, asked, further)
    share, pair = weakest(found, asked)
    enough = float(np.mean([own >= wanted.least for own in found.values()])) if found else 1.0
    label = (
        "" if pair is None else " and ".join(names[n] if n < len(names) else "none" for n in pair)
    )
    yield label, Finding("", share, enough, math.nan, math.nan, None, share), np.empty(0)


def _of_volume(
    own: Laid, roi: Roi, rig: Placement, vehicle: Vehicle, dead: Mapping[str, tuple[int, ...]]
) -> Iterator[Found]:
    sensors = own.requirement.sensors or 1
    every, outside = seen_without(rig, vehicle, roi, [*dead.values()], sensors)
    outside = outside[own.positions.held]
    if not outside.any():
        return  # a trailer that turns is there
    for label, layer in zip(dead, every, strict=True):
        seen = layer[own.positions.held]
        shares = np.divide(seen, outside, out=np.full(len(seen), np.inf), where=outside > 0)
        worst = int(shares.argmin())
        x, y = own.positions.points[worst].tolist()
        share = int(seen.sum()) / int(outside.sum())
        at_worst = float(shares[worst])
        yield label, Finding("", share, share, x, y, None, at_worst), shares
