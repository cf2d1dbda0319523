"""What stays unseen, from above: maps of a rig and of the one it is compared with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lidarplace import OccupancyGrid
from lidarplace.coverage import coverage
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem


def maps(
    rigs: Mapping[str, Choices], problem: Problem, grids: Mapping[str, OccupancyGrid]
) -> dict[str, np.ndarray]:
    """`pog/CLASS`: entropy of each column of voxels; `unseen/CLASS/RIG`: that of the voxels which
    no beam covers; nats, shape (nx, ny), float32."""
    found = {f"pog/{name}": _columns(grid.entropy) for name, grid in grids.items()}
    for rig_name, rig in rigs.items():
        placement = placement_of(rig, problem.models, rig_name)
        for name, grid in grids.items():
            covered = coverage(placement, grid.roi, problem.file.surrogate.method)
            found[f"unseen/{name}/{rig_name}"] = _columns(np.where(covered, 0.0, grid.entropy))
    return found


def _columns(entropy: np.ndarray) -> np.ndarray:
    return entropy.sum(axis=2).astype(np.float32)
