"""What rigs hit of the objects, mount by mount: of a rig that changes only what moved is cast."""

from __future__ import annotations

import threading
from functools import reduce

from cachetools import LRUCache

from lidarplace.placement import Mount, Placement
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.sensor import Lidar

MOUNTS = 256
"""Of which the cells are kept; those of a hundred frames take a few megabytes."""


class SeenCells:
    """Cells of the surfaces of `objects`, kept by mount and LiDAR."""

    def __init__(self, objects: CountedObjects) -> None:
        self.objects = objects
        self._kept: LRUCache[tuple[Mount, Lidar], SurfaceCells] = LRUCache(MOUNTS)
        self._keeping = threading.Lock()

    def of(self, placement: Placement | None) -> SurfaceCells:
        """What a rig hits, None being no LiDAR."""
        if placement is None:
            return SurfaceCells.none(len(self.objects.table))
        pairs = list(zip(placement.mounts, placement.lidars, strict=True))
        with self._keeping:
            known = {pair: self._kept[pair] for pair in pairs if pair in self._kept}
        missing = [pair for pair in pairs if pair not in known]
        alone = [Placement("one", [mount], lidar=lidar) for mount, lidar in missing]
        cast = dict(zip(missing, self.objects.seen_by(alone), strict=True))
        with self._keeping:
            self._kept.update(cast)
        known |= cast
        return reduce(SurfaceCells.and_, (known[pair] for pair in pairs))
