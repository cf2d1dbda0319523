"""Box logs of the Argoverse 2 sensor data set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import IGNORE
from lidarplace.files.columns import integers, numbers, sizes, texts
from lidarplace.files.tables import read_feather
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, POSE_COLUMNS
from lidarplace.scenes.datasets.class_maps import ARGOVERSE, ClassMap, classify, merged
from lidarplace.scenes.datasets.se3 import Poses, poses

ORIGIN = (2.850 / 2, 0.0, -0.33)
"""Our ego origin in the ego frame of Argoverse, metres.

Theirs is the centre of the rear axle, about 33 cm above the ground
(https://github.com/argoverse/argoverse-api/issues/286); ours is on the ground, half a wheelbase
ahead. The vehicles are Ford Fusion Hybrids, whose wheelbase is 2.850 m.
"""

SPLITS = {"train": "train", "val": "test", "test": "test"}
"""Folder of the data set -> split of the box log."""

QUATERNION = ("qw", "qx", "qy", "qz")
TRANSLATION = ("tx_m", "ty_m", "tz_m")
SIZE = ("length_m", "width_m", "height_m")


def read_argoverse(
    folder: Path,
    *,
    splits: Sequence[str] = (),
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
) -> BoxLog:
    """The logs under `folder/<split>/<log>` as one box log.

    A frame is a LiDAR sweep: the time of an annotation, or of a file
    `sensors/lidar/<timestamp_ns>.feather`, of which only the name is read. A sweep without a box is
    missing unless its file is there. Frames count through the logs, split by split, in the order of
    their names; `route` numbers the logs. All boxes are kept, however far away; their pitch and
    roll are lost.

    Args:
        folder: the data set.
        splits: of `SPLITS`; empty: `train` and `val`, or the one that is there. The boxes of the
            public `test` are secret.
        class_map: entries that differ from `class_maps.ARGOVERSE`.
        ignored: gets the number of boxes left out by category.

    Raises:
        ValueError: a file is missing or wrong, a time has no pose, or a category is unknown.
    """
    for split in splits:
        if split not in SPLITS:
            raise ValueError(f"split {split!r}: allowed are {', '.join(SPLITS)}")
    class_map = merged(ARGOVERSE, class_map)
    logs: list[tuple[Path, str]] = []
    for split in splits or [name for name in ("train", "val") if (folder / name).is_dir()]:
        paths = sorted((folder / split).glob("*/"))
        if not paths:
            raise ValueError(f"{folder / split}: must hold a folder for each log")
        logs.extend((path, SPLITS[split]) for path in paths)
    if not logs:
        raise ValueError(f"{folder}: must hold a folder train or val")
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    first = 0
    counter: Counter[str] = Counter() if ignored is None else ignored
    for route, (path, split) in enumerate(logs):
        own_boxes, own_frames = _log(path, first, class_map, counter)
        boxes.append(own_boxes)
        frames.append(own_frames.assign(route=route, split=split))
        first += len(own_frames)
    return BoxLog(
        pd.concat(boxes, ignore_index=True)[list(BOX_COLUMNS)],
        pd.concat(frames, ignore_index=True)[[*FRAME_COLUMNS, *POSE_COLUMNS]],
    )


def _log(
    path: Path, first_frame: int, class_map: ClassMap, ignored: Counter[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Boxes and frames of one log; its frames have numbers from `first_frame`."""
    source = path / "annotations.feather"
    table = read_feather(
        source, ("timestamp_ns", "track_uuid", "category", *SIZE, *QUATERNION, *TRANSLATION)
    )

    def row(index: int) -> str:
        return f"{source}: row {index}"

    time_ns = integers(table, "timestamp_ns", str(source))
    frame_ns = np.union1d(time_ns, _sweeps(path / "sensors" / "lidar"))
    frame = pd.Index(frame_ns).get_indexer(pd.Index(time_ns))
    size = sizes(table, SIZE, str(source))
    position, quaternion = (
        numbers(table, names, str(source)) for names in (TRANSLATION, QUATERNION)
    )
    pose = poses(position, quaternion, row)
    seconds = (frame_ns - frame_ns[:1]) / 1e9
    boxes = pd.DataFrame(
        {
            "scene": path.name,
            "frame": first_frame + frame,
            "timestamp_s": seconds[frame],
            "object_id": texts(table, "track_uuid", str(source)),
            "class": classify(table["category"], class_map, row, ignored),
            **dict(zip("xyz", (pose.position - ORIGIN).T, strict=True)),
            **dict(zip(("length", "width", "height"), size.T, strict=True)),
            "yaw": pose.yaw,
        }
    )
    ego = _vehicle(path / "city_SE3_egovehicle.feather", frame_ns).moved(ORIGIN)
    frames = pd.DataFrame(
        {
            "scene": path.name,
            "frame": first_frame + np.arange(len(frame_ns)),
            "timestamp_s": seconds,
            "ego_x": ego.position[:, 0],
            "ego_y": ego.position[:, 1],
            "ego_yaw": ego.yaw,
        }
    )
    return boxes[boxes["class"] != IGNORE].sort_values("frame", kind="stable"), frames


def _sweeps(folder: Path) -> NDArray[np.int64]:
    """Times of the sweeps that are there, in nanoseconds."""
    for path in (paths := sorted(folder.glob("*.feather"))):
        if not path.stem.isdecimal() or int(path.stem) >= 2**63:
            raise ValueError(f"{path}: a sweep must be named by its time in nanoseconds")
    return np.array([int(path.stem) for path in paths], np.int64)


def _vehicle(path: Path, time_ns: NDArray[np.int64]) -> Poses:
    """Pose of the vehicle in the city at these times, in Argoverse's own ego frame."""
    table = read_feather(path, ("timestamp_ns", *QUATERNION, *TRANSLATION))
    table = table.drop_duplicates("timestamp_ns")
    position, quaternion = (numbers(table, names, str(path)) for names in (TRANSLATION, QUATERNION))
    index = pd.Index(integers(table, "timestamp_ns", str(path))).get_indexer(pd.Index(time_ns))
    if (index < 0).any():
        raise ValueError(f"{path}: no pose at timestamp_ns {time_ns[int(np.argmax(index < 0))]}")

    def row(index: int) -> str:
        return f"{path}: timestamp_ns {time_ns[index]}"

    return poses(position[index], quaternion[index], row)
