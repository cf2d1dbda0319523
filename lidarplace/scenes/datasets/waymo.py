"""Box logs of Waymo's perception data set v2, which is tables of Parquet.

https://github.com/waymo-research/waymo-open-dataset/tree/master/src/waymo_open_dataset/v2 has the
components that the columns are named after.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.class_names import IGNORE
from lidarplace.files.columns import check_columns, integers, numbers, sizes, texts
from lidarplace.files.tables import read_parquet
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, POSE_COLUMNS
from lidarplace.scenes.datasets.class_maps import WAYMO, ClassMap, classify, merged
from lidarplace.scenes.datasets.se3 import Poses

ORIGIN = (3.0 / 2, 0.0, 0.0)
"""Our ego origin in the vehicle frame of Waymo, metres.

Theirs is the middle of the rear axle (https://github.com/waymo-research/waymo-open-dataset/issues/165)
on the ground (issues/597 there); ours lies half a wheelbase ahead. Waymo does not say which vehicle
drove; the wheelbases of its fleet, Chrysler Pacifica and Jaguar I-Pace, are 3.09 and 2.99 m.
"""

SPLITS = {"training": "train", "validation": "test", "testing": "test"}
"""Folder of the data set -> split of the box log."""

SEGMENT, TIME, OBJECT = (
    "key.segment_context_name",
    "key.frame_timestamp_micros",
    "key.laser_object_id",
)
_BOX = "[LiDARBoxComponent]"
TYPE, HEADING = f"{_BOX}.type", f"{_BOX}.box.heading"
CENTRE = tuple(f"{_BOX}.box.center.{axis}" for axis in "xyz")
SIZE = tuple(f"{_BOX}.box.size.{axis}" for axis in "xyz")
POSE = "[VehiclePoseComponent].world_from_vehicle.transform"


def read_waymo(
    folder: Path,
    *,
    splits: Sequence[str] = (),
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
) -> BoxLog:
    """The segments in `folder/<split>/lidar_box` and `vehicle_pose` as one box log.

    A frame is a row of `vehicle_pose`, so those without a box count. Frames count through the
    segments, split by split, in the order of their names; `route` numbers the segments. All boxes
    are kept, however far away.

    Args:
        folder: the data set.
        splits: of `SPLITS`; empty: `training` and `validation`, or the one that is there. The
            boxes of the public `testing` are secret.
        class_map: entries that differ from `class_maps.WAYMO`.
        ignored: gets the number of boxes left out by type.

    Raises:
        ValueError: a file is missing or wrong, a box is in no frame, or a type is unknown.
    """
    for split in splits:
        if split not in SPLITS:
            raise ValueError(f"split {split!r}: allowed are {', '.join(SPLITS)}")
    class_map = merged(WAYMO, class_map)
    present = [name for name in ("training", "validation") if (folder / name).is_dir()]
    segments: list[tuple[Path, str]] = []
    for split in splits or present:
        paths = sorted((folder / split / "lidar_box").glob("*.parquet"))
        if not paths:
            raise ValueError(f"{folder / split / 'lidar_box'}: must hold a file for each segment")
        segments.extend((path, SPLITS[split]) for path in paths)
    if not segments:
        raise ValueError(f"{folder}: must hold a folder training or validation")
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    first, counter = 0, Counter[str]() if ignored is None else ignored
    for route, (path, split) in enumerate(segments):
        own_frames, time = _frames(path.parents[1] / "vehicle_pose" / path.name, first)
        boxes.append(_boxes(path, time, own_frames, class_map, counter))
        frames.append(own_frames.assign(route=route, split=split))
        first += len(own_frames)
    return BoxLog(
        pd.concat(boxes, ignore_index=True)[list(BOX_COLUMNS)],
        pd.concat(frames, ignore_index=True)[[*FRAME_COLUMNS, *POSE_COLUMNS]],
    )


def _frames(path: Path, first: int) -> tuple[pd.DataFrame, NDArray[np.int64]]:
    """Frames of one segment, numbered from `first`, and their times in microseconds, ascending."""
    table, source = _table(path, (SEGMENT, TIME, POSE)), str(path)
    time = integers(table, TIME, source)
    unique, rows = np.unique(time, return_index=True)
    if len(unique) < len(time):
        twice = int(np.setdiff1d(np.arange(len(time)), rows)[0])
        raise ValueError(f"{source}: row {twice}: frame {time[twice]} is there twice")
    matrix = np.stack([_matrix(table[POSE].iloc[row], f"{source}: row {row}") for row in rows])
    try:
        ego = Poses(matrix[:, :3, 3], Rotation.from_matrix(matrix[:, :3, :3])).moved(ORIGIN)
    except ValueError as error:  # a matrix that is no rotation
        raise ValueError(f"{source}: {POSE}: {error}") from None
    frames = pd.DataFrame(
        {
            "scene": texts(table, SEGMENT, source)[rows],
            "frame": first + np.arange(len(unique)),
            "timestamp_s": (unique - unique[:1]) / 1e6,
            "ego_x": ego.position[:, 0],
            "ego_y": ego.position[:, 1],
            "ego_yaw": ego.yaw,
        }
    )
    return frames, unique


def _matrix(value: object, where: str) -> NDArray[np.float64]:
    """A transform of 16 numbers, row by row; (4, 4)."""
    try:
        matrix = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (16,) or not np.isfinite(matrix).all():
        raise ValueError(f"{where}: {POSE} must be 16 finite numbers")
    return matrix.reshape(4, 4)


def _boxes(
    path: Path,
    time: NDArray[np.int64],
    frames: pd.DataFrame,
    class_map: ClassMap,
    ignored: Counter[str],
) -> pd.DataFrame:
    """Boxes of one segment, whose frames are at these times."""
    table, source = _table(path, (SEGMENT, TIME, OBJECT, TYPE, *CENTRE, *SIZE, HEADING)), str(path)
    of_box = integers(table, TIME, source)
    index = pd.Index(time).get_indexer(pd.Index(of_box))
    if (index < 0).any():
        row = int(np.argmax(index < 0))
        raise ValueError(f"{source}: row {row}: no vehicle_pose of frame {of_box[row]}")
    number = integers(table, TYPE, source)
    names = pd.Series([_type(value) for value in number.tolist()], dtype=object)
    boxes = pd.DataFrame(
        {
            **{name: frames[name].to_numpy()[index] for name in ("scene", "frame", "timestamp_s")},
            "object_id": texts(table, OBJECT, source),
            "class": classify(names, class_map, lambda row: f"{source}: row {row}", ignored),
            **dict(zip("xyz", (numbers(table, CENTRE, source) - ORIGIN).T, strict=True)),
            **dict(zip(("length", "width", "height"), sizes(table, SIZE, source).T, strict=True)),
            "yaw": numbers(table, [HEADING], source)[:, 0],
        }
    )
    return boxes[boxes["class"] != IGNORE].sort_values("frame", kind="stable")


def _type(number: int) -> str:
    """The name of a type; a number beyond those that are known is a category of its own."""
    names = list(WAYMO)
    return names[number] if 0 <= number < len(names) else str(number)


def _table(path: Path, names: Sequence[str]) -> pd.DataFrame:
    table = read_parquet(path)
    check_columns(list(table.columns), names, str(path))
    return table.reset_index(drop=True)
