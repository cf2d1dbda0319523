"""Box logs from tables of one's own, Parquet or CSV."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import FRAMES
from lidarplace.files import columns
from lidarplace.files.regular import is_there
from lidarplace.files.tables import read_csv, read_parquet
from lidarplace.logs.box_log import UNIQUE, BoxLog, check_listed, read_buildings, read_rigs
from lidarplace.logs.boxes import (
    CLOUD,
    FRAME_COLUMNS,
    FULL_POSE_COLUMNS,
    GEOMETRY,
    POSE_COLUMNS,
    SIZE,
    SPLITS,
    count_columns,
    first,
    rows_of,
)
from lidarplace.scenes.datasets.class_maps import BOX_LOG, ClassMap, classified, classify, merged

SUFFIXES = (".parquet", ".csv")
TEXT = ("scene", "object_id", "class", "split", CLOUD)
LOG, NO_BOXES = "log", "no boxes"
"""Scene of a frame where it is unknown, and of empty frames of which only the number is known."""
OF_FRAMES = ("scene", "timestamp_s")  # what a frame has, and each of its boxes too
_OTHER_LAYOUTS = {
    "kitti": ("label_2", "training/label_2"),
    "nuscenes": ("v1.0-*", "scene.json"),
    "argoverse": ("train/*/annotations.feather", "val/*/annotations.feather"),
    "waymo": ("training/lidar_box", "validation/lidar_box"),
    "openlabel": ("*.json",),
}
"""Paths that only a folder for this reader has, the first reader first."""
_OTHER_SUFFIXES = {
    ".json": "`lidarplace convert openlabel` reads OpenLABEL, `convert nuscenes` nuScenes",
    ".txt": "`lidarplace convert kitti` reads a folder of KITTI's labels; call a table .csv",
}


def read_tabular(
    source: Path,
    *,
    frames: Path | int | None = None,
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
) -> BoxLog:
    """Read a table of boxes, and what there is about their frames, as a box log.

    Boxes need `frame` (whole numbers), `class` and the columns of `GEOMETRY`; they may have
    `scene`, `timestamp_s` and `object_id` (else each box is an object of its own), and the real
    points in a box: `points`, and `points/NAME` for a LiDAR.

    A table of frames lists every frame, those without boxes too. It needs `frame`, without
    repetition in the whole log, and may have `scene` (else `log`), `timestamp_s` (else empty),
    `route` (else the scenes are numbered), `split` (else all are `train`), `POSE_COLUMNS`,
    `FULL_POSE_COLUMNS`, and `cloud`, the file of a frame's real cloud. What it says of scene and
    time holds for the boxes. Without a table the frames of the boxes are filled up with empty ones,
    of the scene `no boxes`, to the number that is given.

    Args:
        source: table of boxes, or a folder of `boxes` and mostly `frames`, `.parquet` or `.csv`.
        frames: the table of frames or their number, where `source` has no table of them.
        class_map: class by value of `class`, in addition to `CLASSES`; `OwnNames` keeps all.
        ignored: gets the number of boxes left out by value of `class`.

    Raises:
        OSError: a file cannot be read.
        ValueError: a column is missing, a value is wrong, or the frames are unknown."""
    class_map = merged(BOX_LOG, class_map)
    further: dict[str, Any] = {}
    if source.is_dir():
        further = {"buildings": read_buildings(source), "rigs": read_rigs(source)}
        folder, source = source, _table_in(source, "boxes")
        if any(is_there(folder / f"frames{suffix}") for suffix in SUFFIXES):
            if frames is not None:
                raise InputError("has a table of frames; another cannot be given", place=folder)
            frames = _table_in(folder, "frames")
    boxes = _boxes(source)
    if frames is None:
        fix = "add a table of all frames or their number"
        raise InputError("frames without a box are unknown", place=source, fix=fix)
    if isinstance(frames, int):
        table = _counted(boxes, frames, source)
    else:
        table = _listed(boxes, frames, source)
    _set_scene_and_time(boxes, table, source)
    boxes["class"] = classify(boxes["class"], class_map, rows_of(source), ignored)
    return BoxLog(classified(boxes), table, **further)


def _table_in(folder: Path, name: str) -> Path:
    files = [path for suffix in SUFFIXES if is_there(path := folder / f"{name}{suffix}")]
    if len(files) != 1:
        expected = " or ".join(f"{name}{suffix}" for suffix in SUFFIXES)
        number, fix = ("both", "") if files else ("neither", _other_reader(folder))
        raise InputError(place=folder, expected=expected, found=number, fix=fix)
    return files[0]


def read_table(path: Path, texts: Iterable[str] = TEXT) -> pd.DataFrame:
    """Read a table in a Parquet or a CSV file; `texts` are columns in which `007` stays text.

    Raises ValueError if the file cannot be read, or has another suffix."""
    if path.suffix.lower() not in SUFFIXES:
        expected = f"a name that ends in {' or '.join(SUFFIXES)}"
        raise InputError(place=path, expected=expected, fix=_other_reader(path))
    if path.suffix.lower() == ".csv":
        return read_csv(path, dtype=dict.fromkeys(texts, str))
    return read_parquet(path).reset_index(drop=True)


def _other_reader(path: Path) -> str:
    """Name the reader, by the suffix of a file or by what is in a folder; empty if unknown."""
    if not path.is_dir():
        return _OTHER_SUFFIXES.get(path.suffix.lower(), "")
    for name, patterns in _OTHER_LAYOUTS.items():
        if any(next(path.glob(pattern), None) for pattern in patterns):
            return f"`lidarplace convert {name}` reads such a folder"
    return ""


def _boxes(path: Path) -> pd.DataFrame:
    """Read the table of boxes, checked but for the class."""
    boxes = read_table(path)
    _check(boxes, ("frame", "class", *GEOMETRY), (*GEOMETRY, "timestamp_s"), path)
    columns.sizes(boxes, SIZE, str(path))
    for name in count_columns(boxes):
        boxes[name] = columns.counts_if_known(boxes, name, str(path))
    if "object_id" not in boxes:
        boxes["object_id"] = list(map(str, range(len(boxes))))
    return boxes


def _check(table: pd.DataFrame, needed: Sequence[str], numeric: Sequence[str], path: Path) -> None:
    """Make `frame` and `numeric` columns numbers, and see that no text is missing.

    A `timestamp_s` of which nothing is known, as this reader itself leaves it, is dropped."""
    if "timestamp_s" in table and table["timestamp_s"].isna().all():
        del table["timestamp_s"]
    fix = "`lidarplace convert table FILE --propose MAP.yaml` maps other names"
    columns.check_columns(list(table.columns), needed, str(path), fix if "class" in needed else "")
    table["frame"] = columns.frame_numbers(table, str(path))
    for name in table.columns.intersection(list(numeric)):
        table[name] = columns.numbers(table, [name], str(path))
    for name in table.columns.intersection(list(TEXT)):
        table[name] = columns.texts(table, name, str(path))
    if "route" in table:
        table["route"] = columns.groups(table, "route", str(path))


def _listed(boxes: pd.DataFrame, path: Path, source: Path) -> pd.DataFrame:
    """Read the table of frames at `path`, which must list those of the boxes."""
    frames = read_table(path)
    needed = boxes.columns.intersection([*OF_FRAMES])
    names = {*frames.columns}
    poses = [*POSE_COLUMNS] if names & {*POSE_COLUMNS} else []
    poses += FULL_POSE_COLUMNS if names & {*FULL_POSE_COLUMNS} else ()
    _check(frames, ("frame", *needed, *poses), (*poses, "timestamp_s"), path)
    columns.check_values(frames, ["frame"], frames["frame"].duplicated(), UNIQUE, str(path))
    if "split" in frames:
        columns.one_of(frames, "split", SPLITS, str(path))
    check_listed(boxes, frames, str(source), path.name)
    return _complete(frames, poses)


def _counted(boxes: pd.DataFrame, count: int, source: Path) -> pd.DataFrame:
    """List the frames of the boxes, and empty ones after them that make it `count`."""
    FRAMES.check("frames", count)
    filled = boxes[["frame", *boxes.columns.intersection([*OF_FRAMES])]].drop_duplicates("frame")
    if len(filled) > count:
        expected = f"boxes of at most {count} frames"
        raise InputError(place=source, expected=expected, found=len(filled))
    start = filled["frame"].max() + 1 if len(filled) else 0
    empty = pd.DataFrame({"frame": start + np.arange(count - len(filled)), "scene": NO_BOXES})
    if "scene" not in filled:
        filled = filled.assign(scene=LOG)
    return _complete(pd.concat([filled, empty]))


def _complete(frames: pd.DataFrame, poses: Sequence[str] = ()) -> pd.DataFrame:
    """Add missing columns of frames, and sort these by their numbers."""
    for name, value in (("scene", LOG), ("timestamp_s", np.nan), ("split", "train")):
        if name not in frames:
            frames[name] = value
    if "route" not in frames:
        frames["route"] = pd.factorize(frames["scene"], sort=True)[0]
    names = [*FRAME_COLUMNS, *poses, *frames.columns.intersection([CLOUD])]
    return frames.sort_values("frame", ignore_index=True)[names]


def _set_scene_and_time(boxes: pd.DataFrame, frames: pd.DataFrame, source: Path) -> None:
    """Give boxes the scene and time of their frame; a scene they have must be the same."""
    of_box = pd.Index(frames["frame"]).get_indexer(pd.Index(boxes["frame"]))
    scene = frames["scene"].to_numpy()[of_box]
    if "scene" in boxes and (row := first(boxes["scene"] != scene)) is not None:
        problem = f"frame {boxes['frame'].iloc[row]} is in {boxes['scene'].iloc[row]!r} and in "
        problem += f"{scene[row]!r}; frame numbers must differ"
        raise InputError(problem, place=f"{source}: row {row}", key="scene")
    boxes["scene"] = scene
    boxes["timestamp_s"] = frames["timestamp_s"].to_numpy()[of_box]
