"""The box log: which objects were around the vehicle in every frame.

Two tables in the ego frame, metres and radians. `boxes` has one row a box; `frames` lists every
frame, so that frames without a box count too. `frame` is unique within a log.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.files import replacing

CLASSES = ("Car", "Cyclist", "Pedestrian")
"""Object classes. Cyclist is the paper's *Van and Cyclist*: bicycles, motorcycles, box trucks."""

GEOMETRY = ("x", "y", "z", "length", "width", "height", "yaw")
"""A box: centre, size, and yaw about z from the ego x axis."""

BOX_COLUMNS = ("scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY)
FRAME_COLUMNS = ("scene", "frame", "timestamp_s", "route", "split")


def check_boxes(boxes: pd.DataFrame, source: str = "box log") -> None:
    """Raise ValueError that names the column or row, unless `boxes` can be used.

    Needs `frame`, `class` and the columns of `GEOMETRY`, with finite values and sizes >= 0, and
    no frame (or scene, where there is one) missing.
    """
    missing = [name for name in ("frame", "class", *GEOMETRY) if name not in boxes.columns]
    if missing:
        raise ValueError(f"{source}: no column {', '.join(missing)}; found {list(boxes.columns)}")
    for name in frame_keys(boxes):
        row, _ = _first(boxes[[name]].isna().to_numpy())
        if row >= 0:
            raise ValueError(f"{source}: row {row}: {name} is missing")
    geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)
    row, column = _first(~np.isfinite(geometry))
    if row >= 0:
        raise ValueError(
            f"{source}: row {row}: {GEOMETRY[column]} must be a finite number, "
            f"found {geometry[row, column]}"
        )
    row, column = _first(geometry[:, 3:6] < 0)
    if row >= 0:
        raise ValueError(
            f"{source}: row {row}: {GEOMETRY[3 + column]} must be at least 0, "
            f"found {geometry[row, 3 + column]}"
        )


def _first(bad: np.ndarray) -> tuple[int, int]:
    """Row and column of the first True, or (-1, -1)."""
    if not bad.any():
        return -1, -1
    row, column = np.unravel_index(int(np.argmax(bad)), bad.shape)
    return int(row), int(column)


def frame_ids(table: pd.DataFrame) -> np.ndarray:
    """One integer a row, equal where `scene` (if there is one) and `frame` are equal.

    Shape (rows,), int64, numbered from 0 in sorted order.
    """
    groups = table.groupby(frame_keys(table), sort=True, observed=True)
    return groups.ngroup().to_numpy(np.int64)


def frame_keys(*tables: pd.DataFrame) -> list[str]:
    """Columns that name a frame in all of `tables`: `scene`, where they have it, and `frame`."""
    scene = all("scene" in table.columns for table in tables)
    return ["scene", "frame"] if scene else ["frame"]


def write_box_log(folder: Path, boxes: pd.DataFrame, frames: pd.DataFrame) -> None:
    """Write `boxes.parquet` and `frames.parquet` into `folder`, each renamed into place."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table, columns in (
        ("boxes", boxes, BOX_COLUMNS),
        ("frames", frames, FRAME_COLUMNS),
    ):
        with replacing(folder / f"{name}.parquet") as partial:
            table[list(columns)].to_parquet(partial, index=False)


def read_box_log(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read what `write_box_log` wrote. Raises ValueError if a column is missing or a box is bad."""
    boxes = pd.read_parquet(folder / "boxes.parquet")
    frames = pd.read_parquet(folder / "frames.parquet")
    check_boxes(boxes, str(folder / "boxes.parquet"))
    missing = [name for name in FRAME_COLUMNS if name not in frames.columns]
    if missing:
        raise ValueError(f"{folder / 'frames.parquet'}: no column {', '.join(missing)}")
    return boxes, frames
