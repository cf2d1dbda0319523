"""The objects of a log that count, and what rigs hit of them.

Rays are cast at them as for point clouds, without drop-off and noise: objects, buildings and the
vehicle's own body hide what is behind them.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.box_log import BoxLog
from lidarplace.boxes import GEOMETRY
from lidarplace.lidar.clouds import Crop
from lidarplace.lidar.raycast import Hits, cast
from lidarplace.lidar.surroundings import Surroundings
from lidarplace.lidar.visibility import ground_truth
from lidarplace.placement import Mount, Placement
from lidarplace.recall.surface_cells import Surface, SurfaceCells, slices_of, surface_cells
from lidarplace.roi import Roi
from lidarplace.sensor import Lidar


@dataclass(frozen=True, eq=False)
class CountedObjects:
    """Objects of the ground truth, which is the same for every placement; `from_log` finds them.

    Attributes:
        table: by frame; columns of `lidarplace.lidar.visibility.ground_truth`, indexed by row of
            the log's boxes.
        cell: edge of a cell of their surfaces, metres.
        azimuth_share: share of the azimuth steps of a LiDAR that are cast.
    """

    table: pd.DataFrame
    cell: float
    azimuth_share: float
    _surroundings: Surroundings
    _crop: Crop

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
    ) -> CountedObjects:
        """Find the objects that count; casts no ray yet.

        Args:
            roi: objects whose centre it holds count, and points within it; its resolution does
                not matter.
            classes: classes of objects.
            cell: edge of a cell, metres.
            frames: at most so many frames, spread evenly over those of the log; None: all.
            azimuth_share: share of the azimuth steps, as of the clouds that a detector gets.
            seed: of the shapes of the objects.

        Raises:
            ValueError: a box is bad, `frames` is below 1, or `azimuth_share` not within (0, 1].
        """
        if frames is not None and frames < 1:
            raise ValueError(f"frames must be at least 1, found {frames}")
        if not 0 < azimuth_share <= 1:
            raise ValueError(f"azimuth_share must be within (0, 1], found {azimuth_share}")
        log = _some_frames(log, frames)
        table = ground_truth(log, roi.x, roi.y, roi.z, seed)
        table = table[table["class"].isin(list(classes))].sort_values("frame", kind="stable")
        return cls(
            table=table,
            cell=cell,
            azimuth_share=azimuth_share,
            _surroundings=Surroundings(log, seed),
            _crop=(roi.x[0], roi.y[0], roi.z[0], roi.x[1], roi.y[1], roi.z[1]),
        )

    @property
    def geometry(self) -> NDArray[np.float64]:
        """Rows of `GEOMETRY`, shape (objects, 7)."""
        return self.table[list(GEOMETRY)].to_numpy(np.float64)

    def seen_by(self, placements: Sequence[Placement]) -> list[SurfaceCells]:
        """What each placement hits of the objects, in their order; cast in numba's threads.

        A mount that several of them have is cast once. Placements of one LiDAR make the tables of
        a grid of candidates: `SurfaceCells.and_` joins them to rigs.

        Raises:
            ValueError: a LiDAR has no ray in its field of view at this `azimuth_share`.
        """
        share = self.azimuth_share
        rigs = [
            list(
                zip(
                    placement.mounts,
                    (lidar.thinned(share) for lidar in placement.lidars),
                    strict=True,
                )
            )
            for placement in placements
        ]
        mounts = list(dict.fromkeys(mount for rig in rigs for mount in rig))
        _, first = np.unique(self.table["frame"], return_index=True)
        edges = [*first.tolist(), len(self.table)]
        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            frames = list(threads.map(lambda ends: self._cast(mounts, *ends), pairwise(edges)))
        joined = {
            mount: SurfaceCells.joined([of_mount[n] for of_mount in frames])
            for n, mount in enumerate(mounts)
        }
        return [reduce(SurfaceCells.and_, [joined[mount] for mount in rig]) for rig in rigs]

    def _cast(
        self, mounts: Sequence[tuple[Mount, Lidar]], first: int, last: int
    ) -> list[SurfaceCells]:
        """What each mount hits of the objects of one frame, rows `first` to `last`."""
        objects = self.table.iloc[first:last]
        frame = int(objects["frame"].iloc[0])
        rows = self._surroundings.rows(frame)
        owner = pd.Index(objects.index).get_indexer(pd.Index(rows))
        geometry = self.geometry[first:last]
        surface = Surface(geometry, slices_of(geometry, self.cell), owner.astype(np.int64))
        # A building matters if it can stand before a point of the ROI.
        corner = np.maximum(np.abs(self._crop[:3]), np.abs(self._crop[3:]))
        away = max(np.hypot(mount.x, mount.y) for mount, _ in mounts)
        parts = self._surroundings.parts(frame, max(float(np.hypot(*corner[:2])), float(away)))
        memory: dict[int, Hits] = {}
        found = []
        for mount, lidar in mounts:
            hits = cast(mount, lidar, parts, self._crop, into=memory.get(lidar.rays))
            memory[lidar.rays] = hits
            found.append(surface_cells(mount, lidar, hits, surface, self._crop, self.cell))
        return found


def _some_frames(log: BoxLog, most: int | None) -> BoxLog:
    """At most so many frames of a log, spread evenly; boxes are numbered from 0."""
    frames = log.frames.reset_index(drop=True)
    if most is not None and most < len(frames):
        frames = frames.iloc[np.linspace(0, len(frames) - 1, most).round().astype(int)]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
    return BoxLog(boxes.reset_index(drop=True), frames, log.buildings)
