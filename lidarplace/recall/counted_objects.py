"""The objects of a log that count, and what rigs hit of them.

Rays are cast at them as for point clouds, without noise: objects, buildings, the static world and
the vehicle's own body hide what is behind them. Drop-off and corrections lose the same share of the
returns as in clouds. The random number of a ray depends on seed, frame and ray alone: placements
lose the same rays, so their differences vary less, and what a mount hits does not depend on its
place in the rig. In clouds, the LiDARs of a rig have different numbers, the first one these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.hashed import key_of
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.shade import ends_of, in_view
from lidarplace.clouds.shapes import BUILDING
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import BoxLog, evenly
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.housing import COLUMNS, housings_in, without
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.surface_cells import (
    NO_LOSS,
    Loss,
    ObjectFrames,
    SurfaceCells,
    slices_of,
    surface_cells,
)
from lidarplace.rigs.correction import Correction
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

_HAIR_M = 1e-6
"""Rounding of a surface, metres, and far more."""


@dataclass(frozen=True)
class MountedLidar:
    """A LiDAR as it is cast, and the housings that it may meet.

    Housings are rows without the number of the LiDAR."""

    mount: Mount
    lidar: Lidar
    others: tuple[tuple[float, ...], ...]

    @property
    def housings(self) -> NDArray[np.float64]:
        """Rows of `lidarplace.mounting.housing`."""
        rows = np.array(self.others, np.float64).reshape(-1, COLUMNS - 1)
        return np.concatenate([np.zeros((len(rows), 1)), rows], axis=1)


@dataclass(frozen=True, eq=False)
class CountedObjects:
    """Objects of the ground truth, which is the same for every placement; `from_log` finds them.

    Attributes:
        table: by frame; columns of `lidarplace.clouds.visibility.ground_truth`, indexed by row of
            the log's boxes.
        cell: edge of a cell of their surfaces, metres.
        azimuth_share: share of the azimuth steps of a LiDAR that are cast.
        vehicle: carries the LiDARs; None: a sedan."""

    table: pd.DataFrame
    cell: float
    azimuth_share: float
    vehicle: Vehicle | None
    _surroundings: Surroundings
    _crop: Crop
    _seed: int

    @classmethod
    def from_log(
        cls,
        log: BoxLog,
        roi: Roi,
        classes: Sequence[str],
        cell: float,
        *,
        frames: int | None = None,
        azimuth_share: float = 1.0,
        seed: int = 0,
        vehicle: Vehicle | None = None,
    ) -> CountedObjects:
        """Find the objects that count; casts no ray yet.

        Args:
            log: boxes, and what stands around them.
            roi: objects whose centre it holds count, and points within it.
            classes: classes of objects.
            cell: edge of a cell, metres.
            frames: at most so many frames, at least 1, spread evenly over those of the log; None:
                all.
            azimuth_share: share of the azimuth steps, as of the clouds that a detector gets, in (0,
                1].
            seed: of the shapes of the objects, and of the returns that are lost.
            vehicle: carries the LiDARs; None: a sedan."""
        if frames is not None and frames < 1:
            raise InputError(key="frames", expected="at least 1", found=frames)
        if not 0 < azimuth_share <= 1:
            raise InputError(key="azimuth_share", expected="a share in (0, 1]", found=azimuth_share)
        some = evenly(log.frames.reset_index(drop=True), frames)
        boxes = log.boxes[log.boxes["frame"].isin(some["frame"])].reset_index(drop=True)
        log = replace(log, boxes=boxes, frames=some)
        table = ground_truth(log, roi.x, roi.y, roi.z, seed)
        table = table[table["class"].isin(list(classes))].sort_values("frame", kind="stable")
        crop = roi.x[0], roi.y[0], roi.z[0], roi.x[1], roi.y[1], roi.z[1]
        around = Surroundings(log, seed)
        return cls(table, cell, azimuth_share, vehicle, around, crop, seed)

    @property
    def geometry(self) -> NDArray[np.float64]:
        """Rows of `GEOMETRY`, shape (objects, 7)."""
        return np.require(self.table[list(GEOMETRY)], np.float64, ["C", "W"])

    def seen_by(self, placements: Sequence[Placement]) -> list[SurfaceCells]:
        """Return the cells that each placement hits, in their order; cast in numba's threads.

        A mount that several of them have is cast once, if the same LiDARs stand in its way. Tables
        of single candidates are joined to rigs by `SurfaceCells.and_`; their LiDARs do not hide
        each other. Raises ValueError if a LiDAR has no ray in its field of view at this
        `azimuth_share`."""
        rigs = [self.in_rig(placement) for placement in placements]
        lidars = list(dict.fromkeys(lidar for rig in rigs for lidar in rig))
        of_lidar = dict(zip(lidars, self.cells_of(lidars), strict=True))
        return [reduce(SurfaceCells.and_, [of_lidar[lidar] for lidar in rig]) for rig in rigs]

    def in_rig(self, placement: Placement) -> list[MountedLidar]:
        """Return the LiDARs of a rig as they are cast. Raises ValueError as `seen_by` does."""
        housings, rig = housings_in(placement), []
        for number, mount in enumerate(placement.mounts):
            lidar = placement.lidars[number].thinned(self.azimuth_share)
            others = in_view(mount, lidar, without(housings, number))[:, 1:]
            # In one order: whoever of them is dead, they hide the same.
            rig.append(MountedLidar(mount, lidar, tuple(sorted(map(tuple, others.tolist())))))
        return rig

    def cells_of(self, lidars: Sequence[MountedLidar]) -> list[SurfaceCells]:
        """Return the cells that each LiDAR hits; cast in numba's threads."""
        away = max((math.hypot(lidar.mount.x, lidar.mount.y) for lidar in lidars), default=0.0)
        frames = self.frames if away <= self._reach else self._frames(away)

        def cells(lidar: MountedLidar) -> SurfaceCells:
            ends = ends_of(lidar.mount, lidar.lidar, lidar.housings, self.vehicle)
            loss = self._loss(lidar.lidar)
            return surface_cells(
                lidar.mount, lidar.lidar, frames, self._crop, self.cell, ends, loss
            )

        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            return list(threads.map(cells, lidars))

    def _loss(self, lidar: Lidar) -> Loss:
        """Return the loss of a LiDAR on the returns of the objects."""
        if lidar.correction is None and lidar.drop_off == 0:
            return NO_LOSS
        factors = (lidar.correction or Correction()).factors_of(self.table["class"])
        numbers = np.unique(self.table["frame"]).tolist()
        keys = [key_of(self._seed, number, 0) for number in numbers]
        return Loss(lidar.drop_off, factors, np.array(keys, np.uint64).reshape(-1, 3))

    @cached_property
    def frames(self) -> ObjectFrames:
        """The objects and what stands around them, for mounts no farther off than the ROI."""
        return self._frames(self._reach)

    @property
    def _reach(self) -> float:
        """Distance from the vehicle to the farthest corner of the ROI, metres."""
        corner = np.maximum(np.abs(self._crop[:3]), np.abs(self._crop[3:]))
        return float(np.hypot(*corner[:2]))

    def _frames(self, reach: float) -> ObjectFrames:
        """Return the frames with all buildings that can stand before the ROI.

        Those are no farther off than `reach`."""
        geometry = self.geometry
        numbers, first = np.unique(self.table["frame"], return_index=True)
        row_of = pd.Series(np.arange(len(self.table)), self.table.index)
        body, parts, owners = body_parts(self.vehicle), [], []
        for number in numbers.tolist():
            parts.append(body.and_(self._surroundings.parts(number, reach)))
            owner = parts[-1].owner
            # What does not count hides like a building.
            rows = row_of.reindex(self._surroundings.rows(number), fill_value=BUILDING)
            owners.append(np.where(owner < 0, BUILDING, rows.to_numpy()[np.maximum(owner, 0)]))
        edges = np.append(first, len(geometry)).astype(np.int64)
        world = [self._surroundings.world(number) for number in numbers.tolist()]
        turns = [np.eye(3) if frame is None else frame.turn for frame in world]
        shifts = [np.zeros(3) if frame is None else frame.shift for frame in world]
        return ObjectFrames(
            parts=np.concatenate([np.empty((0, 10)), *(frame.geometry for frame in parts)]),
            owner=np.concatenate([np.empty(0, np.int32), *owners]).astype(np.int32),
            reflectivity=np.concatenate([np.empty(0), *(frame.reflectivity for frame in parts)]),
            first_part=np.cumsum([0, *map(len, parts)], dtype=np.int64),
            first_object=edges,
            near=_around(geometry, edges, self._crop),
            geometry=geometry,
            slices=slices_of(geometry, self.cell),
            worlds=self._surroundings.worlds,
            scene=np.array([-1 if frame is None else frame.scene for frame in world], np.int64),
            turn=np.array(turns).reshape(-1, 3, 3),
            shift=np.array(shifts).reshape(-1, 3),
        )


def _around(
    geometry: NDArray[np.float64], edges: NDArray[np.int64], crop: Crop
) -> NDArray[np.float64]:
    """Return boxes that hold all objects of every frame, cut to `crop`, (frames, 6)."""
    half = 0.5 * geometry[:, 3:6]
    c, s = np.abs(np.cos(geometry[:, 6])), np.abs(np.sin(geometry[:, 6]))
    reach = np.stack(
        [c * half[:, 0] + s * half[:, 1], s * half[:, 0] + c * half[:, 1], half[:, 2]], axis=1
    )
    low = np.maximum(geometry[:, :3] - reach - _HAIR_M, crop[:3])
    high = np.minimum(geometry[:, :3] + reach + _HAIR_M, crop[3:])
    if not len(geometry):
        return np.empty((0, 6))
    return np.concatenate(
        [np.minimum.reduceat(low, edges[:-1]), np.maximum.reduceat(high, edges[:-1])], axis=1
    )
