"""What becomes of requirements under a rig.

An object is placed at every position of a grid, in the worst of several headings. A requirement is
met if enough positions have enough, as the rig is built and in every case that it names besides.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.near_field import seen_in_columns
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

    A LiDAR that is dead costs nothing: what a rig has without one is told from the counts of all.
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
            dead = own.requirement.also_when.one_lidar_dead and case == AS_BUILT
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


def _of_objects(own: Laid, sights: list[Sight], rig: Placement, dead: bool) -> Iterator[Found]:
    wanted, placed = own.requirement, own.requirement.placed
    assert placed is not None
    sights = at_class(sights, rig, placed.object_class)
    there = ~np.isnan(own.boxes[:, :, 0])
    boxes = own.boxes[there]
    if wanted.measure == "points":
        counts = count_points(sights, boxes, placed.reflectivity)
    else:
        counts = count_cells(sights, boxes, wanted.cell, placed.reflectivity)
    cases = {"": counts.all}
    for number in range(len(rig.mounts) if dead else 0):
        cases[f"without LiDAR {number + 1}"] = counts.all - counts.alone[:, number]
    for label, numbers in cases.items():
        by_heading = np.full(there.shape, np.inf)
        by_heading[there] = wanted.curve.probability(numbers) if wanted.curve else numbers
        yield label, *_worst_heading(own, by_heading)


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
    own: Laid, roi: Roi, rig: Placement, vehicle: Vehicle, dead: bool
) -> Iterator[Found]:
    cases: dict[str, int | None] = {"": None}
    for number in range(len(rig.mounts) if dead else 0):
        cases[f"without LiDAR {number + 1}"] = number
    for label, unseeing in cases.items():
        seen, outside = seen_in_columns(rig, vehicle, roi, unseeing)
        seen, outside = seen[own.positions.held], outside[own.positions.held]
        shares = np.divide(seen, outside, out=np.full(len(seen), np.inf), where=outside > 0)
        worst = int(shares.argmin())
        x, y = own.positions.points[worst].tolist()
        share = int(seen.sum()) / int(outside.sum())
        at_worst = float(shares[worst])
        yield label, Finding("", share, share, x, y, None, at_worst), shares
