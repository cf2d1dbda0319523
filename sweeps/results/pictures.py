"""Pictures of a sweep's report: maps from above, the ground around the vehicle, one frame."""

from collections.abc import Collection, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.coverage import coverage
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.table import DECIDING
from lidarplace.requirements.tables import Ground
from sweeps.plan.trial import DetectorTrial, Plan, Trial
from sweeps.stages.pog import grids_of
from sweeps.store.local import Store
from tracking.run_folders.arrays import Frame, Grounds, Maps

MOST_UNTESTED = 12
"""Most placements drawn of a sweep that trained nothing, best first."""


def drawn(
    trials: Sequence[Trial], tested: Sequence[Trial], surrogates: pd.DataFrame
) -> list[Trial]:
    """Choose trials to draw, one a placement: tested ones, else the best by a surrogate."""
    by_name: dict[str, Trial] = {}
    for trial in tested or trials:
        by_name.setdefault(trial.grid_point.point.placement, trial)
    if tested or len(by_name) <= MOST_UNTESTED:
        return list(by_name.values())
    for name in DECIDING:
        of_surrogate = surrogates[surrogates["surrogate"] == name]
        if len(of_surrogate):
            best = of_surrogate.groupby("placement")["value"].sum().nlargest(MOST_UNTESTED)
            return [by_name[placement] for placement in best.index]
    return list(by_name.values())[:MOST_UNTESTED]


def maps(trials: Sequence[Trial], store: Store) -> Maps:
    """Compute the maps of the trials' placements."""
    pog = store.load(trials[0].pog)
    grids = grids_of(pog)
    collected = Maps({name: pog.from_above[name] for name in grids}, {}, {})
    for trial in trials:
        point = trial.grid_point.point
        covered = coverage(trial.grid_point.rig, point.voxel_roi(), point.surrogate.method)
        collected.coverage[point.placement] = covered.mean(axis=2, dtype=np.float32)
        collected.residual[point.placement] = uncovered(grids.values(), covered)
    return collected


def uncovered(grids: Collection[OccupancyGrid], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Sum the entropy that is not covered over z, nats, shape (nx, ny).

    A layer at a time: an array of all voxels is as large as a machine's memory may be."""
    layers = (
        np.where(hit, 0.0, sum(grid.entropy_of_count[grid.counts[i]] for grid in grids))
        for i, hit in enumerate(covered)
    )
    return np.array([layer.sum(axis=1) for layer in layers], np.float32)


def grounds(plan: Plan, trials: Sequence[Trial], store: Store) -> Grounds:
    """Load the ground around the vehicle under each requirement and the trials' placements."""
    names = [result.requirement.name for result in plan.layouts]
    by_rig = {}
    for trial in trials:
        if trial.requirements is not None and store.has(trial.requirements):
            result = store.load(trial.requirements)
            by_rig[trial.grid_point.point.placement] = [
                Ground(result.x[number], result.y[number], result.least[number].astype(np.float64))
                for number in map(str, range(len(names)))
            ]
    return Grounds.of(outline(trials[0].grid_point.vehicle or Vehicle.car()), names, by_rig)


def one_frame(trials: Sequence[DetectorTrial], store: Store) -> Frame:
    """Load the test frame with most objects, as every placement sees it."""
    first = trials[0]
    objects = pd.concat([store.load(task).objects for task in first.ground_truths])
    of_test = np.concatenate([store.read(t, lambda own: own.frames) for t in first.collect_test])
    numbers = objects["frame"].to_numpy()
    counts = np.array([np.count_nonzero(numbers == frame) for frame in of_test])
    frame = of_test[np.argmax(counts)]
    in_frame = objects[objects["frame"] == frame]
    boxes = in_frame[list(GEOMETRY)].to_numpy(np.float64)
    collected = Frame(boxes, in_frame["class"].to_numpy(np.str_), {}, {})
    for trial in trials:
        name = trial.grid_point.point.placement
        for task in trial.collect_test:
            clouds = store.load(task)
            for index in np.flatnonzero(clouds.frames == frame).tolist():
                collected.points[name] = clouds[index]
                collected.lidar[name] = clouds.lidar(index)
    return collected
