"""What the report draws of a sweep: maps from above, and one frame as every placement sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.boxes import GEOMETRY
from lidarplace.coverage import coverage
from lidarplace.files import replacing
from lidarplace.lidar.clouds import PointClouds
from sweeps.grid import Sweep
from sweeps.plan import Trial
from sweeps.store import AnyStore, Value

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
    for name in ("expected_ig", "covered_entropy", "expected_points"):
        own = surrogates[surrogates["surrogate"] == name]
        if len(own):
            best = own.groupby("placement")["value"].sum().nlargest(MOST_UNTESTED)
            return [by_name[placement] for placement in best.index]
    return list(by_name.values())[:MOST_UNTESTED]


def maps(sweep: Sweep, trials: Sequence[Trial], store: AnyStore) -> Value:
    """From above: `coverage/PLACEMENT`, the covered share, and `pog/CLASS`, the entropy in nats,
    of each column of voxels; shape (nx, ny), float32."""
    found: Value = {}
    for trial in trials:
        point = trial.grid_point.point
        rig = sweep.common.placement_named(point.placement, point.lidar.lidar())
        covered = coverage(rig, point.voxel_roi(), point.surrogate.method)
        found[f"coverage/{point.placement}"] = covered.mean(axis=2, dtype=np.float32)
    classes = trials[0].grid_point.point.classes
    names = {f"from_above_{name}": f"pog/{name}" for name in classes}
    pog = store.load(trials[0].pog, tuple(names))
    return found | {names[name]: array for name, array in pog.items()}


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
