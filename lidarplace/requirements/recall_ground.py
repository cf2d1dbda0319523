"""Recall over the ground around a vehicle, also with the LiDAR dead that costs most of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import CELL_M, IOU, default_curves
from lidarplace.requirements.area import Area
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.rays_on_objects import at_class, count_cells, sights_of
from lidarplace.requirements.requirement import STANDARD, Requirement
from lidarplace.rigs.placement import Placement

REACH_M = 40.0
"""Distance of the ground's sides from the vehicle's, metres."""
STEP_M = 2.0
"""Edge of a cell, metres."""
HARDEST = ("Pedestrian", "Cyclist", "Car")
"""Classes of objects, those with the least surface first."""


@dataclass(frozen=True, eq=False)
class RecallGround:
    """Probability that a detector finds a single object in each cell of the ground.

    Attributes:
        object_class: of the object, which has the class's standard size.
        x, y: middles of the cells, metres, shapes (nx,) and (ny,).
        built: the mean over headings, NaN within the vehicle, shape (nx, ny).
        degraded: the same with the LiDAR `dead`; equal to `built` for a single LiDAR.
        dead: number from 0 of the LiDAR without which the mean over the ground is least.
        takes_time: whether a LiDAR takes time for a frame, which the ground ignores."""

    object_class: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    built: NDArray[np.float64]
    degraded: NDArray[np.float64]
    dead: int | None
    takes_time: bool = False


def recall_ground(rig: Placement, vehicle: Vehicle, object_class: str) -> RecallGround:
    """Compute the ground for a class, one of `HARDEST`.

    By the detection curve of the package; nothing but the vehicle and its LiDARs hides objects."""
    extents = vehicle.body.extents[:, :, :2]
    low = extents[:, 0].min(axis=0, initial=0.0) - REACH_M
    high = extents[:, 1].max(axis=0, initial=0.0) + REACH_M
    area = Area(x=(low[0], high[0]), y=((low[1], high[1]),))
    placed = replace(STANDARD[object_class], headings=2)
    curve = default_curves().of(object_class, IOU)
    requirement = Requirement(
        object_class, area, "probability", 0.0, placed, step=STEP_M, curve=curve
    )
    layout = lay_out(requirement, vehicle)
    sights = at_class(sights_of(rig, vehicle.poses[""]), rig, object_class)
    every = range(len(rig.mounts))
    sets = [every, *([n for n in every if n != dead] for dead in every if len(every) > 1)]
    free = ~np.isnan(layout.boxes[:, :, 0])
    chances = np.full((*free.shape, len(sets)), np.nan)
    chances[free] = curve.probability(count_cells(sights, layout.boxes[free], CELL_M, sets=sets))
    means = np.nanmean(chances, axis=0)
    held = layout.positions.held
    maps = np.full((len(sets), *held.shape), np.nan)
    maps[:, held] = means.T
    dead = int(means[:, 1:].mean(axis=0).argmin()) if len(every) > 1 else None
    degraded = maps[0] if dead is None else maps[1 + dead]
    x, y = layout.positions.x, layout.positions.y
    return RecallGround(object_class, x, y, maps[0], degraded, dead, rig.takes_time)
