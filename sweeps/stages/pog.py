"""The stage that counts how often each voxel is occupied."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from lidarplace import OccupancyGrid, Roi
from lidarplace.logs.box_log import BoxLog
from sweeps.stages.stage import VoxelStage, training_log


@dataclass(frozen=True, eq=False)
class Pog:
    """Occupancy of every class.

    `classes`: in the order of the configuration. `frames`: T, of the training split. `roi`: voxels.
    `counts`: by class, frames in which each voxel is occupied, shape (nx, ny, nz), int32.
    `from_above`: by class, entropy summed over z, nats, shape (nx, ny), float32."""

    classes: Sequence[str]
    frames: int
    roi: Roi
    counts: Mapping[str, NDArray[np.int32]]
    from_above: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class PogStage(VoxelStage[Pog]):
    """Count the occupancy by every class over the frames of the training split.

    Test frames stay out: a surrogate predicts how a placement does on what was not seen."""

    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    classes: Annotated[tuple[str, ...], "classes"]

    name = "pog"
    order = 80

    def bytes_per_voxel(self) -> int:
        return 4 + 4 * len(self.classes)

    def run(self, *logs: BoxLog) -> Pog:
        log = training_log(logs)
        frames = len(log.frames)
        grids = OccupancyGrid.by_class(log.boxes, self.roi, self.classes, frames=frames)
        # Not `grid.entropy`, which is twice as large as the counts and stays in memory.
        from_above = {
            name: np.array(
                [grid.entropy_of_count[counts].sum(axis=1) for counts in grid.counts], np.float32
            )
            for name, grid in grids.items()
        }
        counts = {name: grid.counts for name, grid in grids.items()}
        return Pog(list(grids), frames, self.roi, counts, from_above)


@lru_cache(maxsize=1)
def grids_of(pog: Pog) -> dict[str, OccupancyGrid]:
    """Return the grids of a POG by class; those of the last POG are kept with derived values."""
    return {
        name: OccupancyGrid(pog.roi, name, pog.counts[name], pog.frames) for name in pog.classes
    }
