"""Box logs of the Argoverse 2 sensor data set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.columns import counts_if_known, integers, numbers, sizes, texts
from lidarplace.files.regular import is_there
from lidarplace.files.tables import read_feather
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, POINTS, SOURCE, first, geometry_of, rows_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.class_maps import ARGOVERSE, ClassMap, classify, merged
from lidarplace.scenes.datasets.drives import Drive, drives_in, in_frames, join_drives, recorded_rig
from lidarplace.scenes.datasets.se3 import Poses, poses

ORIGIN = (2.850 / 2, 0.0, -0.33)
"""Our ego origin in the ego frame of Argoverse, metres. Theirs is the centre of the rear axle,
about 33 cm above the ground (https://github.com/argoverse/argoverse-api/issues/286); ours is on the
ground, half a wheelbase ahead. The vehicles are Ford Fusion Hybrids, whose wheelbase is 2.850 m."""

CLOUDS_ORIGIN = (-ORIGIN[0], 0.0, -ORIGIN[2])
"""The ego frame of Argoverse, in which its sweeps are, starts here in ours, metres."""
SPLITS = {"train": "train", "val": "test", "test": "test"}
"""Folder of the data set -> split of the box log."""
QUATERNION = ("qw", "qx", "qy", "qz")
TRANSLATION = ("tx_m", "ty_m", "tz_m")
SIZE = ("length_m", "width_m", "height_m")
COUNT = "num_interior_pts"
LIDARS = ("up_lidar", "down_lidar")  # in the order in which lasers count through them


def read_argoverse(
    folder: Path,
    *,
    splits: Sequence[str] = (),
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
    lidar: Lidar | None = None,
    keep_ignored: bool = False,
) -> BoxLog:
    """Read the logs under `folder/<split>/<log>` as one box log.

    A frame is a LiDAR sweep: the time of an annotation, or of a file
    `sensors/lidar/<timestamp_ns>.feather`, of which only the name is read. A sweep without a box is
    missing unless its file is there. Frames count through the logs, split by split, in the order of
    their names; `route` numbers the logs. Pitch and roll of boxes are lost. Boxes have their number
    of interior points as `POINTS`, and a log with `calibration/egovehicle_SE3_sensor.feather` has
    its rig.

    Args:
        folder: the data set.
        splits: of `SPLITS`; empty: `train` and `val`, or the one that is there.
        class_map: entries that differ from `class_maps.ARGOVERSE`.
        ignored: gets the number of boxes left out by category.
        lidar: model of both LiDARs; None: VLP-32C.
        keep_ignored: keep boxes of ignored categories as `class_maps.OTHER`, which hide.

    Raises ValueError if a file is missing or wrong, a time has no pose, or a category is unknown.
    """
    drives = drives_in(folder, splits, SPLITS, "*/", "a folder for each log")
    classes = merged(ARGOVERSE, class_map, keep_ignored)
    return join_drives(drives, lambda path, start: _log(path, start, classes, ignored, lidar))


def _log(
    path: Path, start: int, class_map: ClassMap, ignored: Counter[str] | None, lidar: Lidar | None
) -> Drive:
    source = path / "annotations.feather"
    table = read_feather(
        source,
        ("timestamp_ns", "track_uuid", "category", *SIZE, *QUATERNION, *TRANSLATION),
        (COUNT,),
    )
    time_ns = integers(table, "timestamp_ns", str(source))
    frame_ns = np.union1d(time_ns, _sweeps(path / "sensors" / "lidar"))
    frame = pd.Index(frame_ns).get_indexer(pd.Index(time_ns))
    columns: dict[str, Any] = {"object_id": texts(table, "track_uuid", str(source))}
    columns["class"] = classify(table["category"], class_map, rows_of(source), ignored)
    columns |= in_ego(table, str(source))
    if COUNT in table:
        columns[POINTS] = counts_if_known(table, COUNT, str(source))
    ego = _vehicle(path / "city_SE3_egovehicle.feather", frame_ns).moved(ORIGIN)
    sweeps = f"{path.parent.name}/{path.name}/sensors/lidar"
    frames = pd.DataFrame(
        {
            "scene": path.name,
            "frame": start + np.arange(len(frame_ns)),
            "timestamp_s": (frame_ns - frame_ns[:1]) / 1e9,
            **ego.ego_columns(),
            CLOUD: [f"{sweeps}/{ns}.feather" for ns in frame_ns],
            SOURCE: [f"{path.name}/{ns}" for ns in frame_ns],
        }
    )
    calibration = path / "calibration" / "egovehicle_SE3_sensor.feather"
    rig = _rig(calibration, lidar or Lidar.named("vlp32c")) if is_there(calibration) else None
    return in_frames(frames, frame, columns), frames, rig


def _rig(path: Path, lidar: Lidar) -> RecordedRig:
    table = read_feather(path, ("sensor_name", *QUATERNION, *TRANSLATION))
    names = texts(table, "sensor_name", str(path)).tolist()
    for name in LIDARS:
        if names.count(name) != 1:
            raise InputError(place=path, expected=f"one sensor {name}", found=names.count(name))
    table = table.iloc[[names.index(name) for name in LIDARS]]
    position, quaternion = _transforms(table, path)
    sensors = poses(position - ORIGIN, quaternion, lambda row: f"{path}: {LIDARS[row]}")
    return recorded_rig("argoverse", LIDARS, sensors, [lidar] * len(LIDARS))


def _transforms(
    table: pd.DataFrame, source: object
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions, (rows, 3), and quaternions, (rows, 4)."""
    return numbers(table, TRANSLATION, str(source)), numbers(table, QUATERNION, str(source))


def in_ego(table: pd.DataFrame, source: str) -> dict[str, NDArray[np.float64]]:
    """Return columns of `GEOMETRY` from `SIZE`, `QUATERNION` and `TRANSLATION` of a table.

    Raises ValueError that names file, row and value."""
    size = sizes(table, SIZE, source)
    pose = poses(*_transforms(table, source), rows_of(source))
    return geometry_of(pose.position - ORIGIN, size, pose.yaw)


def _sweeps(folder: Path) -> NDArray[np.int64]:
    """Return the times of the sweeps that have a file, in nanoseconds."""
    for path in (paths := sorted(folder.glob("[!.]*.feather"))):
        if not path.stem.isdecimal() or int(path.stem) >= 2**63:
            raise InputError(place=path, expected="a name that is the time in nanoseconds")
    return np.array([int(path.stem) for path in paths], np.int64)


def _vehicle(path: Path, time_ns: NDArray[np.int64]) -> Poses:
    """Return the pose of the vehicle in the city at these times, in Argoverse's own ego frame."""
    table = read_feather(path, ("timestamp_ns", *QUATERNION, *TRANSLATION))
    table = table.drop_duplicates("timestamp_ns")
    position, quaternion = _transforms(table, path)
    index = pd.Index(integers(table, "timestamp_ns", str(path))).get_indexer(pd.Index(time_ns))
    if (row := first(index < 0)) is not None:
        raise InputError(f"no pose at {time_ns[row]}", place=path, key="timestamp_ns")
    where = f"{path}: timestamp_ns"
    return poses(position[index], quaternion[index], lambda row: f"{where} {time_ns[row]}")
