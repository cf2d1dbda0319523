"""A label file, read by its mapping."""

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.files.columns import counts_if_known, numbers, sizes, texts
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, GEOMETRY, POINTS, SIZE, count_columns
from lidarplace.scenes.label_tables.frames import Stamps, frames_of, read_stamps
from lidarplace.scenes.label_tables.mapping import TableMapping
from lidarplace.scenes.label_tables.poses import read_track
from lidarplace.scenes.label_tables.read_table import check_mapped, read_table
from lidarplace.scenes.label_tables.units import METRES, RADIANS


def read_label_table(path: Path, mapping: TableMapping, ignored: Counter[str]) -> BoxLog:
    """The boxes of a label file as a box log; its frames have poses if the mapping has.

    Args:
        path: CSV or Parquet, a row a box.
        ignored: gets the number of boxes left out by category.

    Raises:
        ValueError: a column is missing, a value is none, a category is in no class, an object is
            twice in a frame, or time stamps, drives or poses do not fit; names file, column and
            row.
    """
    columns, source = mapping.columns, str(path)
    table = read_table(path, [columns.drive, columns.object, columns.category])
    check_mapped(table, {f"columns.{key}": name for key, name in columns}, source)
    if table.empty:
        raise ValueError(f"{source}: has no row")
    stamps = read_stamps(table, columns.drive, mapping.stamp, columns.time is None, source)
    frames, frame = frames_of(stamps, mapping, source)
    boxes = pd.DataFrame(_geometry(table, mapping, source), columns=list(GEOMETRY))
    poses = None
    if mapping.poses is not None:
        track = read_track(table, mapping, mapping.poses, source)
        poses = track.at(Stamps(frames["scene"].to_numpy(), frames["stamp"].to_numpy()))
        if mapping.coordinates == "world":
            boxes[list(GEOMETRY)] = track.at(stamps).seen(boxes.to_numpy())
    for axis in "xyz":
        boxes[axis] += getattr(mapping.origin, axis)
    boxes["class"] = _classes(table, mapping, source)
    boxes["scene"], boxes["frame"] = stamps.drive, frame
    boxes["timestamp_s"] = frames["timestamp_s"].to_numpy()[frame]
    boxes["object_id"] = (
        texts(table, columns.object, source) if columns.object else boxes.index.map(str)
    )
    if columns.points is not None:
        boxes[POINTS] = counts_if_known(table, columns.points, source)
    left_out = boxes["class"].isna()
    ignored.update(texts(table, columns.category, source)[left_out])
    kept = boxes[~left_out]
    _check_objects(kept, mapping, source)
    kept = kept.sort_values("frame", kind="stable", ignore_index=True)
    kept = kept[[*BOX_COLUMNS, *count_columns(kept)]]
    frames = frames[list(FRAME_COLUMNS)]
    if poses is not None:
        frames = pd.concat([frames, poses.ego(mapping.origin)], axis=1)
    return BoxLog(kept, frames)


def _geometry(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.float64]:
    """Rows of `GEOMETRY` in metres and radians, z at the centre; (rows, 7)."""
    columns, units = mapping.columns, mapping.units
    place = numbers(table, [columns.x, columns.y, columns.z], source) * METRES[units.position]
    size = sizes(table, [getattr(columns, side) for side in SIZE], source) * METRES[units.size]
    if mapping.box_z == "bottom":
        place[:, 2] += size[:, 2] / 2
    yaw = numbers(table, [columns.yaw], source) * RADIANS[units.angle]
    return np.hstack([place, size, yaw])


def _classes(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.object_]:
    """The class of every row, None where it is left out."""
    column = mapping.columns.category
    category = texts(table, column, source)
    unknown = np.array([name not in mapping.classes for name in category])
    if unknown.any():
        row = int(np.argmax(unknown))
        counts = Counter(category[unknown])
        names = ", ".join(f"{name} {count:,}" for name, count in counts.most_common(10))
        raise ValueError(
            f"{source}: column {column}: {unknown.mean():.1%} of the rows, from row {row}, have a "
            f"category that `classes` does not name: {names}; null leaves one out"
        )
    return np.array([mapping.classes[name] for name in category], object)


def _check_objects(boxes: pd.DataFrame, mapping: TableMapping, source: str) -> None:
    """Raise ValueError if an object is twice in a frame; `boxes` have the rows of the file."""
    twice = boxes.duplicated(["frame", "object_id"])
    if twice.any():
        box = boxes[twice].iloc[0]
        raise ValueError(
            f"{source}: column {mapping.columns.object}: {twice.mean():.1%} of the rows repeat an "
            f"object in its frame, the first is row {twice.idxmax()} with {box['object_id']!r} of "
            f"drive {box['scene']!r}; mend columns.object, columns.drive, or what makes frames: "
            f"{mapping.stamp}, units.time and frames.rate_hz"
        )
