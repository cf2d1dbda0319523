"""What stays unseen, from above: maps of a rig and of the one it is compared with."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lidarplace import OccupancyGrid
from lidarplace.coverage import coverage
from sweeps.results.pictures import uncovered
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem
from tracking.run_folders.search_arrays import UnseenMaps


def maps(
    rigs: Mapping[str, Choices], problem: Problem, grids: Mapping[str, OccupancyGrid]
) -> UnseenMaps:
    """The maps of the POG by class, and of what each rig leaves unseen of it."""
    unseen: dict[str, dict[str, NDArray[np.float32]]] = {name: {} for name in grids}
    for rig_name, rig in rigs.items():
        placement = placement_of(rig, problem.models, rig_name)
        for name, grid in grids.items():
            covered = coverage(placement, grid.roi, problem.file.surrogate.method)
            unseen[name][rig_name], _ = uncovered([grid], covered)
    pog = {
        name: uncovered([grid], np.broadcast_to(np.False_, grid.counts.shape))[0]
        for name, grid in grids.items()
    }
    return UnseenMaps(pog, unseen)
