"""What becomes of requirements under a rig.

An object is placed at every position of a grid, in the worst of several headings. A requirement is
met if enough positions have enough, as the rig is built and in every case that it names besides.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.near_field import seen_without
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Positions
from lidarplace.requirements.layout import Laid
from lidarplace.requirements.rays_on_objects import (
    Sight,
    at_class,
    count_cells,
    count_points,
    sights_of,
)
from lidarplace.requirements.requirement import AS_BUILT, Requirement
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class Finding:
    """What a requirement finds in one case.

    Attributes:
        case: `AS_BUILT`, a dead LiDAR, a shorter range or mounts that are off.
        value: what the share of positions that counts has at least; of coverage the share seen.
        enough: share of the positions that have enough; of coverage the share seen.
        x, y: the worst position, or column of voxels, metres.
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


def judge(laid: Sequence[Laid], placement: Placement, vehicle: Vehicle) -> list[Outcome]:
    """What becomes of requirements that are laid out around `vehicle` under one rig.

    LiDARs that are dead cost little: what a rig has without them is told from the counts of all.
    One inside of the vehicle's body sees nothing.
    """
    sights: dict[Placement, list[Sight]] = {}

    def sights_once(rig: Placement) -> list[Sight]:
        if rig not in sights:
            sights[rig] = sights_of(rig, vehicle)
        return sights[rig]

    outcomes = []
    for own in laid:
        findings, least = [], np.full(int(own.positions.held.sum()), np.inf)
        for case, rig in own.requirement.also_when.variants(placement).items():
            names = [f"LiDAR {number + 1}" for number in range(len(rig.mounts))]
            dead: dict[str, tuple[int, ...]] = {"": ()}
            if case == AS_BUILT:
                dead = own.requirement.also_when.dead(names, len(rig.mounts))
            if own.roi is None:
                values = _of_objects(own, sights_once(rig), rig, dead)
            else:
                values = _of_volume(own, own.roi, rig, vehicle, dead)
            for label, finding, shown in values:
                findings.append(replace(finding, case=label or case))
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
    wanted, placed = own.requirement, own.requirement.placed
    assert placed is not None
    sights = at_class(sights, rig, placed.object_class)
    there = ~np.isnan(own.boxes[:, :, 0])
    boxes = own.boxes[there]
    if wanted.measure == "points":
        counts = count_points(sights, boxes, placed.reflectivity, [*dead.values()])
    else:
        counts = count_cells(sights, boxes, wanted.cell, placed.reflectivity, [*dead.values()])
    curve = wanted.curve.probability if wanted.curve else np.asarray
    each = None if wanted.sensors is None else curve(counts.each)
    for number, (label, without) in enumerate(dead.items()):
        by_heading = np.full(there.shape, np.inf)
        if each is None or wanted.sensors is None:
            by_heading[there] = curve(counts.left[:, number])
        else:
            by_heading[there] = by_several(each, without, wanted.sensors)
        yield label, *_worst_heading(own, by_heading)


def by_several(each: NDArray[np.float64], dead: Sequence[int], sensors: int) -> NDArray[np.float64]:
    """What so many sensors have at least, each by itself; 0 where there are fewer.

    Args:
        each: of every sensor, shape (B, sensors).
        dead: numbers of sensors that do not count.
    """
    alive = np.delete(each, list(dead), axis=1)
    number = alive.shape[1]
    if number < sensors:
        return np.zeros(len(each))
    return np.asarray(np.partition(alive, number - sensors, axis=1)[:, number - sensors])


def _worst_heading(
    own: Laid, by_heading: NDArray[np.float64]
) -> tuple[Finding, NDArray[np.float64]]:
    wanted, placed = own.requirement, own.requirement.placed
    assert placed is not None
    values = by_heading.min(axis=0)
    worst = int(values.argmin())
    x, y = own.positions.points[worst].tolist()
    may_fail = min(math.floor((1 - wanted.share) * len(values) + 1e-9), len(values) - 1)
    finding = Finding(
        case="",
        value=float(np.sort(values)[may_fail]),
        enough=float((values >= wanted.least).mean()),
        x=x,
        y=y,
        heading=float(placed.angles[by_heading[:, worst].argmin()]),
        at_worst=float(values[worst]),
    )
    return finding, values


def _of_volume(
    own: Laid, roi: Roi, rig: Placement, vehicle: Vehicle, dead: Mapping[str, tuple[int, ...]]
) -> Iterator[Found]:
    sensors = own.requirement.sensors or 1
    every, outside = seen_without(rig, vehicle, roi, [*dead.values()], sensors)
    outside = outside[own.positions.held]
    for label, layer in zip(dead, every, strict=True):
        seen = layer[own.positions.held]
        shares = np.divide(seen, outside, out=np.full(len(seen), np.inf), where=outside > 0)
        worst = int(shares.argmin())
        x, y = own.positions.points[worst].tolist()
        share = int(seen.sum()) / int(outside.sum())
        at_worst = float(shares[worst])
        yield label, Finding("", share, share, x, y, None, at_worst), shares
