"""Shares of every requirement that each LiDAR of a grid has alone: the numbers of the programme."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace import Placement
from lidarplace.base.errors import InputError
from lidarplace.mounting.near_field import seen_voxels
from lidarplace.mounting.vehicle import Vehicle, voxels_in_body
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.requirements.rays_on_objects import (
    Sight,
    at_class,
    count_points,
    missed_cells,
    sights_of,
)
from lidarplace.requirements.requirement import AS_BUILT, KIND_OF
from sweeps.search.cheapest.cheapest_rig import TOLERANCE
from sweeps.search.problem.assess import Criteria
from sweeps.search.problem.constraints import Carrier, requirement_name
from sweeps.search.problem.rig import MountedLidar, placement_of

_MOST_BYTES = 4e9
_WHOLE = 255
"""Value of `Block.missed` for a part that is surely missed."""


@dataclass(frozen=True, eq=False)
class Block:
    """A requirement in one case, over the R objects that it places.

    A LiDAR counts as if it were alone on the vehicle. Others can only hide something from it, so
    sums and unions of these numbers are never below what a rig has.

    Attributes:
        key: of the requirement and case.
        name: of the constraint.
        alone: share of the need of each object that each of L LiDARs has alone, shape (L, R).
        missed: probability in 255ths that a LiDAR misses each of C parts of the object, rounded
            down, shape (L, R, C); None where numbers of LiDARs simply add up.
        needed: number of parts.
        position: of each object; the objects of a position are its headings.
        areas: area around each position, in cells of their grid, shape (P,).
        may_fail: area of the positions that may have too little; 0: none may.
        dead: number of LiDARs without any of which it has to hold, too.
        sensors: number of LiDARs that have to have enough, each by itself; 0: all together."""

    key: tuple[int, str, str]
    name: str
    alone: NDArray[np.float32]
    missed: NDArray[np.uint8] | None
    needed: float
    position: NDArray[np.int64]
    areas: NDArray[np.float64]
    may_fail: float
    dead: int
    sensors: int

    def nothing(self) -> NDArray[np.float64]:
        """Return the state without LiDARs, to which `plus` adds."""
        if self.missed is None:
            return np.zeros(self.alone.shape[1])
        return np.ones(self.missed.shape[1:])

    def plus(self, state: NDArray[np.float64], lidars: Iterable[int]) -> NDArray[np.float64]:
        """Return the state with further LiDARs."""
        for lidar in lidars:
            if self.missed is None:
                state = state + self.alone[lidar]
            else:
                state = state * (self.missed[lidar] / _WHOLE)
        return state

    def shares(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return shares of the need, shape (R,)."""
        if self.missed is None:
            return state
        return np.asarray((1.0 - state).sum(axis=1) / self.needed)

    def of(self, lidars: Iterable[int]) -> NDArray[np.float64]:
        """Return the shares that LiDARs have together, shape (R,)."""
        return self.shares(self.plus(self.nothing(), lidars))

    def gains(self, row: int, lidars: Sequence[int]) -> tuple[float, NDArray[np.float64]]:
        """Return a row that every rig keeps: the share of LiDARs, and what each adds at most, (L,).

        Where numbers add up, the share is 0, and gains do not depend on the LiDARs."""
        if self.missed is None:
            return 0.0, self.alone[:, row].astype(np.float64)
        left = np.prod(self.missed[list(lidars), row] / _WHOLE, axis=0)
        gains = (_WHOLE - self.missed[:, row]) @ left / (_WHOLE * self.needed)
        gains[list(lidars)] = 0.0
        return float((1.0 - left).sum() / self.needed), gains

    def short(self, shares: NDArray[np.float64], level: float) -> NDArray[np.intp]:
        """Return objects with less than `level` of the need; none if so many positions may fail."""
        rows = np.flatnonzero(shares < level)
        area = self.areas[np.unique(self.position[rows])].sum()
        return rows if area > self.may_fail + TOLERANCE or not self.may_fail else rows[:0]


def blocks_of(lidars: Sequence[MountedLidar], criteria: Criteria) -> list[Block]:
    """Compute the blocks of each LiDAR, as built and in every case but mounts that are off.

    What a drawn rig has depends on the order of its LiDARs, so only exact checks know it. Raises
    ValueError: the numbers need too much memory."""
    carrier, by_case = criteria.carrier, dict[tuple[int, str, str], list[NDArray[Any]]]()
    layouts = list(filter(_adds_up, carrier.requirements))
    for lidar in lidars:
        rig = placement_of((lidar,), carrier.models)
        for key, values in _of_one(rig, layouts, carrier.hiding):
            by_case.setdefault(key, []).append(values)
        size = len(lidars) * sum(values[0].nbytes for values in by_case.values())
        if size > _MOST_BYTES:
            most, needed = (f"{number / 1e9:.0f} GB" for number in (_MOST_BYTES, size))
            problem = f"too many candidates: numbers of {len(lidars):,} LiDARs"
            fix = "enlarge position_step or angle_step_deg, or step of the requirements"
            raise InputError(
                problem, key="search.greedy", expected=f"at most {most}", found=needed, fix=fix
            )
    every = by_case.items()
    return [_block(key, layouts[key[0]], np.array(values), carrier) for key, values in every]


def _adds_up(layout: RequirementLayout) -> bool:
    """Return whether a requirement is of LiDARs one by one; others need exact checks."""
    wanted = layout.requirement
    return wanted.common_view is None and not wanted.needs and wanted.measure not in KIND_OF


def _of_one(
    rig: Placement, layouts: Sequence[RequirementLayout], vehicle: Vehicle
) -> Iterator[tuple[tuple[int, str, str], NDArray[Any]]]:
    """Yield requirement, case, and what a single LiDAR has of objects, or misses of their parts."""
    sights: dict[tuple[Placement, str], list[Sight]] = {}
    poses = vehicle.poses.items()
    for number, layout in enumerate(layouts):
        wanted = layout.requirement
        variants = replace(wanted.also_when, mounts_off=None).variants(rig).items()
        for (pose, body), (case, variant) in itertools.product(poses, variants):
            key = number, pose, case
            if layout.roi is not None:
                inside = voxels_in_body(body, layout.roi)[layout.positions.held]
                if not inside.all():
                    seen = seen_voxels(variant, body, layout.roi)[layout.positions.held]
                    yield key, np.where(seen.reshape(1, -1), 0, _WHOLE).astype(np.uint8)
                continue
            assert wanted.placed is not None
            if (variant, pose) not in sights:
                sights[variant, pose] = sights_of(variant, body)
            at = at_class(sights[variant, pose], variant, wanted.placed.object_class)
            boxes, light = layout.boxes_in(pose), wanted.placed.reflectivity
            boxes = boxes[~np.isnan(boxes[:, :, 0])]
            if len(boxes) and wanted.measure == "points":
                yield key, count_points(at, boxes, light)[:, 0].astype(np.float32)
            elif len(boxes):
                missed = missed_cells(at, boxes, wanted.cell, light)
                yield key, np.floor(missed * _WHOLE).astype(np.uint8)


def _block(
    key: tuple[int, str, str], layout: RequirementLayout, values: NDArray[Any], carrier: Carrier
) -> Block:
    wanted, (_, pose, case), fails = layout.requirement, key, 0.0
    fits = ~np.isnan(layout.boxes_in(pose)[:, :, 0])
    objects, areas, needed = np.nonzero(fits)[1], np.ones(fits.shape[1]), wanted.least
    if layout.roi is not None:
        inside = voxels_in_body(carrier.hiding.poses[pose], layout.roi)[layout.positions.held]
        objects, areas, needed = np.zeros(1, int), np.ones(1), needed * float((~inside).sum())
    elif wanted.share < 1:  # as much as may fail at positions that are then refined
        areas = layout.areas_in(pose)
        fails = min(1.0 - wanted.share + layout.precision(pose), 1.0) * float(areas.sum())
    if wanted.curve is not None:
        needed = wanted.curve.cells(needed)  # as many cells as find it
    missed = values if values.ndim == 3 else None
    alone = values if missed is None else 1.0 - missed.mean(axis=2) / _WHOLE
    alone = alone * np.float32((1 if missed is None else missed.shape[2]) / needed)
    sensors = wanted.sensors or 0 if layout.roi is None else 0
    if sensors:  # each by itself
        alone, missed = (alone >= 1.0 - 1e-6) / np.float32(sensors), None
    also = wanted.also_when
    dead = max(int(also.one_lidar_dead), also.sensors_dead) if case == AS_BUILT else 0
    name, alone = requirement_name(wanted.name), np.asarray(alone, np.float32)
    return Block(key, name, alone, missed, needed, objects, areas, fails, dead, sensors)
