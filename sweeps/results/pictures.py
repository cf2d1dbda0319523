"""What the report draws of a sweep: maps from above, and one frame as every placement sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY
from lidarplace.coverage import coverage
from lidarplace.files.atomic import replacing
from lidarplace.lidar.clouds import PointClouds
from lidarplace.occupancy.entropy import entropy_of_counts
from lidarplace.surrogates.table import DECIDING
from sweeps.configuration.grid import Sweep
from sweeps.plan.plan import Trial
from sweeps.store.local import Value
from sweeps.store.open import AnyStore

MOST_UNTESTED = 12
"""Placements drawn of a sweep that trained nothing, best first."""


def drawn(known: Sequence[Trial], tested: Sequence[Trial], surrogates: pd.DataFrame) -> list[Trial]:
    """A trial of every placement to draw: those that were tested, else the best by a surrogate.

    Args:
        surrogates: placement, surrogate, value of all `known`.
    """
    by_name: dict[str, Trial] = {}
    for trial in tested or known:
        by_name.setdefault(trial.grid_point.point.placement, trial)
    if tested or len(by_name) <= MOST_UNTESTED:
        return list(by_name.values())
    for name in DECIDING:
        own = surrogates[surrogates["surrogate"] == name]
        if len(own):
            best = own.groupby("placement")["value"].sum().nlargest(MOST_UNTESTED)
            return [by_name[placement] for placement in best.index]
    return list(by_name.values())[:MOST_UNTESTED]


def maps(sweep: Sweep, trials: Sequence[Trial], store: AnyStore) -> Value:
    """What `tracking.run_folders.sweep.Maps` holds: `pog/CLASS`, and for every placement
    `coverage/PLACEMENT` and `residual/PLACEMENT` from above, the same with `_side` from the side.
    """
    found: Value = {}
    classes = trials[0].grid_point.point.classes
    names = {f"from_above_{name}": f"pog/{name}" for name in classes}
    pog = store.load(trials[0].pog)
    entropy = sum(_entropy(pog[f"counts_{name}"], pog["frames"]) for name in classes)
    for trial in trials:
        point = trial.grid_point.point
        rig = sweep.common.placement_named(point.placement, point.lidar.lidar())
        covered = coverage(rig, point.voxel_roi(), point.surrogate.method)
        residual = np.where(covered, np.float32(0), entropy)
        for suffix, axis in (("", 2), ("_side", 1)):
            place = f"{suffix}/{point.placement}"
            found[f"coverage{place}"] = covered.mean(axis=axis, dtype=np.float32)
            found[f"residual{place}"] = residual.sum(axis=axis)
    return found | {names[name]: pog[name] for name in names}


def _entropy(counts: NDArray[np.int32], frames: int) -> NDArray[np.float32]:
    """H of every voxel, nats. Not `OccupancyGrid.entropy`, which is twice as large and stays."""
    return entropy_of_counts(np.arange(int(counts.max()) + 1), frames).astype(np.float32)[counts]


def one_frame(trials: Sequence[Trial], store: AnyStore) -> Value:
    """The test frame with most objects, as every placement sees it."""
    objects = pd.concat([store.load(task)["objects"] for task in trials[0].ground_truths])
    of_test = np.concatenate([store.load(task)["frames"] for task in trials[0].collect_test])
    numbers = objects["frame"].to_numpy()
    found = np.array([np.count_nonzero(numbers == frame) for frame in of_test])
    frame = of_test[np.argmax(found)]
    shown = objects[objects["frame"] == frame]
    arrays: Value = {
        "boxes": shown[list(GEOMETRY)].to_numpy(np.float64),
        "labels": shown["class"].to_numpy(np.str_),
    }
    for trial in trials:
        name = trial.grid_point.point.placement
        for task in trial.collect_test:
            clouds = PointClouds.from_arrays(store.load(task))
            for index in np.flatnonzero(clouds.frames == frame).tolist():
                arrays[f"points/{name}"] = clouds[index]
                arrays[f"lidar/{name}"] = clouds.lidar(index)
    return arrays


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name into one file, in one step."""
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
