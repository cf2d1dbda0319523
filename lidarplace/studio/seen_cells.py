"""What rigs hit of the objects, mount by mount: of a rig that changes only what moved is cast."""

import threading
from functools import reduce

from cachetools import LRUCache

from lidarplace.recall.counted_objects import CountedObjects, InRig
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.rigs.placement import Placement

MOUNTS = 256
"""Of which the cells are kept; those of a hundred frames take a few megabytes."""


class SeenCells:
    """Cells of the surfaces of `objects`, kept by LiDAR and what of its rig is in its way."""

    def __init__(self, objects: CountedObjects) -> None:
        self.objects = objects
        self._kept: LRUCache[InRig, SurfaceCells] = LRUCache(MOUNTS)
        self._keeping = threading.Lock()

    def of(self, placement: Placement | None) -> SurfaceCells:
        """What a rig hits, None being no LiDAR."""
        if placement is None:
            return SurfaceCells.none(len(self.objects.table))
        lidars = self.objects.in_rig(placement)
        with self._keeping:
            known = {lidar: self._kept[lidar] for lidar in lidars if lidar in self._kept}
        missing = [lidar for lidar in lidars if lidar not in known]
        cast = dict(zip(missing, self.objects.cells_of(missing), strict=True))
        with self._keeping:
            self._kept.update(cast)
        known |= cast
        return reduce(SurfaceCells.and_, (known[lidar] for lidar in lidars))
