"""The folder that a sweep leaves behind, read into one object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.command_line.invocation import command
from lidarplace.files.arrays import check_numbers, read_npz
from lidarplace.files.atomic import read_text
from lidarplace.placement import Mount
from lidarplace.roi import Roi
from tracking.run_folders.json_file import read_result_file
from tracking.run_folders.sweep_json import SweepResult
from tracking.run_folders.tables import read_result_table

RESULT_KEYS = ("trial", "placement", "class", "detector", "seed", "metric", "iou", "difficulty")

_REQUIRED_TABLES: dict[str, tuple[str, ...]] = {
    "results": (*RESULT_KEYS, "value", "ground_truths"),
    "surrogates": ("placement", "class", "surrogate", "value"),
    "trials": ("trial", "placement", "detector", "seed", "seconds", "status", "error"),
}
_OPTIONAL_TABLES: dict[str, tuple[str, ...]] = {
    "expected_ig_by_q": ("placement", "class", "q", "expected_ig"),
    "curves": ("trial", "epoch", "metric", "value"),
    "pr_curves": (*RESULT_KEYS[:-1], "recall", "precision"),
    "distance": (*RESULT_KEYS[:-1], "from_m", "to_m", "value", "ground_truths"),
    "left_out": (*RESULT_KEYS[:-1], "unit", "left_out", "ground_truths", "value"),
    "points": (
        *("placement", "class", "from_m", "to_m", "objects"),
        *("mean", "median", "p10", "unseen"),
    ),
    "individuals": ("split", "scene", "route", "class", "object_id", "boxes"),
    "accuracy": (
        *("placement", "class", "surrogate", "method", "resolution", "azimuth_steps", "frames"),
        *("comparable", "reference", "seconds", "pog_seconds"),
    ),
    "sampling_error": ("placement", "class", "surrogate", "value", "sd", "bias", "low", "high"),
    "pog_resamples": ("placement", "class", "surrogate", "resample", "value"),
    "tasks": ("stage", "label", "seconds", "cached"),
    "promotions": (
        *("rung", "detector", "placement", "by", "class", "value", "rank", "kept", "seconds"),
        "setting",
    ),
}
_LATER_TASK_COLUMNS: dict[str, float | str | bool] = {
    "started": np.nan,
    "ended": np.nan,
    "node": "",
    "peak_memory": np.nan,
    "batch_size_reduced": False,
}
"""Columns that older run folders lack, and what stands for not known."""
_LOCK = ".lock"
"""File that a sweep leaves in its folder from the start; it writes the others at its end."""


@dataclass(frozen=True)
class Maps:
    """What lies around the vehicle and what placements cover of it, over the ROI.

    From above is by columns of voxels, shape (nx, ny); from the side, seen along y, by rows of
    voxels, shape (nx, nz). All are float32. Older run folders have no residual entropy and nothing
    from the side.

    Attributes:
        pog: by class, the entropy in nats, from above.
        coverage, coverage_side: by placement, the covered share, in [0, 1].
        residual, residual_side: by placement, the entropy of all classes that no beam covers, nats.
    """

    pog: dict[str, NDArray[np.float32]]
    coverage: dict[str, NDArray[np.float32]]
    coverage_side: dict[str, NDArray[np.float32]]
    residual: dict[str, NDArray[np.float32]]
    residual_side: dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Frame:
    """One frame as every placement sees it, in the ego frame.

    Attributes:
        points: by placement, x, y, z in metres and intensity, shape (n, 4), float32.
        lidar: by placement, the mount that each point comes from, shape (n,), uint8.
        boxes: ground truth x, y, z, length, width, height, yaw, shape (m, 7), float64.
        labels: class of every box, shape (m,), str.
    """

    points: dict[str, NDArray[np.float32]]
    lidar: dict[str, NDArray[np.uint8]]
    boxes: NDArray[np.float64]
    labels: NDArray[np.str_]


@dataclass(frozen=True)
class RunFolder:
    """Everything that a sweep left in `path`.

    `config.yaml`, `sweep.json`, `results.parquet`, `surrogates.parquet` and `trials.parquet` must
    be there. The others are None when the sweep did not make them. A sweep of surrogates alone has
    no results, and trials whose detector is "".

    Attributes:
        config: text of the resolved configuration.
        sweep: `sweep.json`.
        roi: the region of interest.
        placements: mounts by the placement's name.
        axes: further axes of the grid, columns of `results` and `trials`.
        tasks: with started, ended, node, peak_memory and batch_size_reduced, unknown in old runs.
        promotions: how every rung of `promote:` ranked the placements.
        pr_curves: precision over recall of every trial, percent.
        distance: AP and recall of every trial by the objects' distance, percent.
        left_out: the results of every trial without each route and each individual of the test
            frames in turn, percent; older run folders lack it.
        points: points per object of the test frames by distance, one of the settings that
            surrogates depend on.
        individuals: in how many frames of a split and a route every object counts.
    """

    path: Path
    config: str
    sweep: SweepResult
    roi: Roi
    placements: dict[str, tuple[Mount, ...]]
    axes: tuple[str, ...]
    results: pd.DataFrame
    surrogates: pd.DataFrame
    trials: pd.DataFrame
    expected_ig_by_q: pd.DataFrame | None
    curves: pd.DataFrame | None
    pr_curves: pd.DataFrame | None
    distance: pd.DataFrame | None
    left_out: pd.DataFrame | None
    points: pd.DataFrame | None
    individuals: pd.DataFrame | None
    accuracy: pd.DataFrame | None
    sampling_error: pd.DataFrame | None
    pog_resamples: pd.DataFrame | None
    tasks: pd.DataFrame | None
    promotions: pd.DataFrame | None
    maps: Maps | None
    frame: Frame | None

    @property
    def classes(self) -> tuple[str, ...]:
        """Object classes in the order of the configuration."""
        return self.sweep.classes

    @classmethod
    def read(cls, path: Path) -> RunFolder:
        """Read the run folder `path`.

        Raises:
            ValueError: `path` is no run folder, its sweep has not finished, a required file is
                missing, or a file lacks a column, key or array that it must have, or has text where
                numbers belong.
        """
        path = Path(path)
        required = ["config.yaml", "sweep.json", *(f"{name}.parquet" for name in _REQUIRED_TABLES)]
        missing = [name for name in required if not (path / name).is_file()]
        if missing == required and (path / _LOCK).is_file():
            raise ValueError(
                f"{path} has no results yet: its sweep has not finished. "
                f"`{command('sweeps.status', 'FILE')}` tells where it stands, FILE being its "
                "configuration"
            )
        if missing:
            raise ValueError(f"{path} is no run folder: it has no {', '.join(missing)}")
        sweep = read_result_file(path / "sweep.json", SweepResult)
        tables = {
            name: read_result_table(path / f"{name}.parquet", columns)
            for name, columns in _REQUIRED_TABLES.items()
        }
        optional: dict[str, pd.DataFrame | None] = {
            name: read_result_table(file, columns)
            if (file := path / f"{name}.parquet").is_file()
            else None
            for name, columns in _OPTIONAL_TABLES.items()
        }
        for name in ("surrogates", "trials"):
            unknown = tables[name].loc[
                ~tables[name]["placement"].isin(sweep.placements), "placement"
            ]
            if len(unknown):
                raise ValueError(
                    f"{path / 'sweep.json'}: placements: has no {unknown.iloc[0]!r}, which is in "
                    f"{name}.parquet"
                )
        reserved = {*RESULT_KEYS, "value", "ground_truths"}
        axes = tuple(axis for axis in sweep.axes if axis not in reserved)
        # An axis over placements, detectors or seeds is one of the fixed columns already.
        axes = tuple(axis for axis in axes if axis in tables["trials"].columns)
        missing_axes = [axis for axis in axes if axis not in tables["results"].columns]
        if missing_axes and len(tables["results"]):
            raise ValueError(
                f"{path / 'results.parquet'} has no column {', '.join(missing_axes)}, an axis of "
                f"trials.parquet; found {', '.join(map(str, tables['results'].columns))}"
            )
        results = tables["results"].reindex(columns=[*tables["results"].columns, *missing_axes])
        tasks, promotions = optional["tasks"], optional["promotions"]
        return cls(
            path=path,
            config=read_text(path / "config.yaml"),
            sweep=sweep,
            roi=sweep.roi,
            placements=sweep.rigs,
            axes=axes,
            results=results,
            surrogates=tables["surrogates"],
            trials=_detector_named(tables["trials"]),
            expected_ig_by_q=optional["expected_ig_by_q"],
            curves=optional["curves"],
            pr_curves=optional["pr_curves"],
            distance=optional["distance"],
            left_out=optional["left_out"],
            points=optional["points"],
            individuals=optional["individuals"],
            accuracy=optional["accuracy"],
            sampling_error=optional["sampling_error"],
            pog_resamples=optional["pog_resamples"],
            tasks=None if tasks is None else _with_later_columns(tasks),
            promotions=None if promotions is None else _detector_named(promotions),
            maps=_read_maps(path / "maps.npz"),
            frame=_read_frame(path / "frame.npz"),
        )


def _detector_named(table: pd.DataFrame) -> pd.DataFrame:
    """`table` with the detector "" where there is none."""
    return table.assign(detector=table["detector"].astype(object).fillna(""))


def _with_later_columns(tasks: pd.DataFrame) -> pd.DataFrame:
    missing = {k: v for k, v in _LATER_TASK_COLUMNS.items() if k not in tasks.columns}
    return tasks.assign(**missing)


def _read_maps(path: Path) -> Maps | None:
    if not path.is_file():
        return None
    arrays = read_npz(path)
    for name, array in arrays.items():
        check_numbers(name, array, 2, path)
    return Maps(**{field.name: _folder(arrays, field.name) for field in fields(Maps)})


def _read_frame(path: Path) -> Frame | None:
    if not path.is_file():
        return None
    arrays = read_npz(path)
    missing = [name for name in ("boxes", "labels") if name not in arrays]
    if missing:
        raise ValueError(f"{path} has no array {', '.join(missing)}; found {', '.join(arrays)}")
    frame = Frame(
        points=_folder(arrays, "points"),
        lidar=_folder(arrays, "lidar"),
        boxes=arrays["boxes"],
        labels=arrays["labels"],
    )
    _check_frame(frame, path)
    return frame


def _check_frame(frame: Frame, path: Path) -> None:
    """Raise ValueError unless the arrays are of the shapes that `Frame` tells."""
    check_numbers("boxes", frame.boxes, 2, path)
    if frame.boxes.shape[1] != 7 or frame.labels.shape != frame.boxes.shape[:1]:
        raise ValueError(
            f"{path}: boxes need 7 numbers and a label each, found {frame.boxes.shape} and "
            f"{frame.labels.shape} labels"
        )
    if frame.labels.dtype.kind != "U":
        raise ValueError(f"{path}: labels must hold text, found {frame.labels.dtype}")
    if set(frame.points) != set(frame.lidar):
        raise ValueError(
            f"{path}: points of {', '.join(frame.points)}, but lidar of {', '.join(frame.lidar)}"
        )
    for name, points in frame.points.items():
        check_numbers(f"points/{name}", points, 2, path)
        check_numbers(f"lidar/{name}", frame.lidar[name], 1, path)
        if points.shape != (len(frame.lidar[name]), 4):
            raise ValueError(
                f"{path}: points/{name} needs 4 numbers for each of {len(frame.lidar[name])} "
                f"points, found shape {points.shape}"
            )


def _folder(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    """Arrays called `prefix/<name>`, by name, in the order of the file."""
    start = f"{prefix}/"
    return {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}
