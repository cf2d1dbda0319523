"""Box logs of Waymo's perception data set v2, which is tables of Parquet.

https://github.com/waymo-research/waymo-open-dataset/tree/master/src/waymo_open_dataset/v2 has the
components that the columns are named after."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns, counts_if_known, integers, numbers, sizes, texts
from lidarplace.files.regular import is_there
from lidarplace.files.tables import read_parquet
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POINTS, SOURCE, first, geometry_of, rows_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.rigs.rotations import rotations_of
from lidarplace.scenes.datasets.class_maps import WAYMO, ClassMap, classify, merged
from lidarplace.scenes.datasets.drives import Drive, drives_in, in_frames, join_drives, recorded_rig
from lidarplace.scenes.datasets.se3 import Poses

ORIGIN = (3.0 / 2, 0.0, 0.0)
"""Our ego origin in the vehicle frame of Waymo, metres. Theirs is the middle of the rear axle
(https://github.com/waymo-research/waymo-open-dataset/issues/165) on the ground (issues/597 there);
ours lies half a wheelbase ahead. Waymo does not say which vehicle drove; the wheelbases of its
fleet, Chrysler Pacifica and Jaguar I-Pace, are 3.09 and 2.99 m."""

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
COUNTS = {
    f"{_BOX}.num_lidar_points_in_box": POINTS,
    f"{_BOX}.num_top_lidar_points_in_box": f"{POINTS}/TOP",
}
"""Column of real points -> that of the box log. Versions before 2.0.1 have none of the second."""
LIDARS = ("TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR")
"""LiDARs in the order of their numbers, from 1."""
IMAGE = {"TOP": (64, 2650, 75.0)}
"""Range image: beams, azimuth steps of a turn, and metres that it was cut to
(https://waymo.com/open/data/perception)."""
SHORT_RANGE_IMAGE = (200, 600, 20.0)  # of the others
_CALIBRATION = "[LiDARCalibrationComponent]"
LASER, EXTRINSIC = "key.laser_name", f"{_CALIBRATION}.extrinsic.transform"
INCLINATIONS = tuple(f"{_CALIBRATION}.beam_inclination.{name}" for name in ("min", "max", "values"))


def read_waymo(
    folder: Path,
    *,
    splits: Sequence[str] = (),
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
    lidar: Lidar | None = None,
    keep_ignored: bool = False,
) -> BoxLog:
    """Read the segments in `folder/<split>/lidar_box` and `vehicle_pose` as one box log.

    A frame is a row of `vehicle_pose`, so those without a box count. Frames count through the
    segments, split by split, in the order of their names; `route` numbers the segments. Boxes have
    their numbers of points; a segment with a file in `lidar_calibration` has its rig.

    Args:
        folder: the data set.
        splits: of `SPLITS`; empty: `training` and `validation`, or the one that is there.
        class_map: entries that differ from `class_maps.WAYMO`.
        ignored: gets the number of boxes left out by type.
        lidar: model of all LiDARs; None: by the inclinations of the calibration.
        keep_ignored: keep boxes of ignored types as `class_maps.OTHER`, which hide.

    Raises ValueError if a file is missing or wrong, a box is in no frame, or a type is unknown."""
    pattern, each = "lidar_box/[!.]*.parquet", "a file for each segment"
    drives = drives_in(folder, splits, SPLITS, pattern, each)
    classes = merged(WAYMO, class_map, keep_ignored)
    return join_drives(drives, lambda path, start: _segment(path, start, classes, ignored, lidar))


def _segment(
    path: Path, start: int, class_map: ClassMap, ignored: Counter[str] | None, lidar: Lidar | None
) -> Drive:
    frames, time = _frames(path.parents[1] / "vehicle_pose" / path.name, start)
    boxes = _boxes(path, time, frames, class_map, ignored)
    calibration = path.parents[1] / "lidar_calibration" / path.name
    return boxes, frames, _rig(calibration, lidar) if is_there(calibration) else None


def _rig(path: Path, lidar: Lidar | None) -> RecordedRig:
    table, source = _table(path, (LASER, EXTRINSIC, *INCLINATIONS)), str(path)
    numbered = integers(table, LASER, source)
    if not len(table) or ((numbered < 1) | (numbered > len(LIDARS))).any():
        raise InputError(place=source, key=LASER, expected=f"1 to {len(LIDARS)}", found=numbered)
    names = [LIDARS[number - 1] for number in numbered]
    sensors = _poses(table, EXTRINSIC, np.arange(len(table)), source)
    sensors = Poses(sensors.position - ORIGIN, sensors.rotation)
    angles = zip(*(table[name] for name in INCLINATIONS), strict=True)
    lidars = [lidar or _lidar(n, ends, source) for n, ends in zip(names, angles, strict=True)]
    return recorded_rig("waymo", names, sensors, lidars)


def _lidar(name: str, inclinations: Sequence[Any], source: str) -> Lidar:
    """Return the model that wrote the range image of a LiDAR.

    `inclinations` are least, greatest, and each."""
    low, high, each = inclinations
    beams, steps, reach = IMAGE.get(name, SHORT_RANGE_IMAGE)
    try:
        values = np.asarray([] if each is None else each, np.float64)
        if not values.size:
            edges = np.linspace(float(low), float(high), beams + 1)
            values = (edges[1:] + edges[:-1]) / 2
        return Lidar(tuple(np.sort(values).tolist()), steps, reach)
    except (TypeError, ValueError) as error:
        raise InputError(f"beam inclinations of {name}: {error}", place=source) from None


def _frames(path: Path, start: int) -> tuple[pd.DataFrame, NDArray[np.int64]]:
    """Read the frames of a segment, and their times in microseconds, ascending."""
    table, source = _table(path, (SEGMENT, TIME, POSE)), str(path)
    time = integers(table, TIME, source)
    if (row := first(pd.Series(time).duplicated())) is not None:
        raise InputError("duplicate frame", place=f"{source}: row {row}", key=TIME, found=time[row])
    rows = np.argsort(time)
    frames = pd.DataFrame(
        {
            "scene": texts(table, SEGMENT, source)[rows],
            "frame": start + np.arange(len(rows)),
            "timestamp_s": (time[rows] - time[rows[:1]]) / 1e6,
            **_poses(table, POSE, rows, source).moved(ORIGIN).ego_columns(),
            SOURCE: frame_names(table, source)[rows],
        }
    )
    return frames, time[rows]


def _poses(table: pd.DataFrame, column: str, rows: NDArray[np.int64], source: str) -> Poses:
    """Return poses of the transforms in these rows: of 16 numbers, row by row of a matrix."""
    matrices = np.empty((len(rows), 16))
    for matrix, row in zip(matrices, rows.tolist(), strict=True):
        try:
            values = np.asarray(table[column].iloc[row], np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape != (16,) or not np.isfinite(values).all():
            raise InputError(place=f"{source}: row {row}", key=column, expected="16 finite numbers")
        matrix[:] = values
    transforms = matrices.reshape(-1, 4, 4)
    turned = rotations_of(transforms[:, :3, :3], lambda row: f"{source}: row {rows[row]}: {column}")
    return Poses(transforms[:, :3, 3], turned)


def _boxes(
    path: Path,
    time: NDArray[np.int64],
    frames: pd.DataFrame,
    class_map: ClassMap,
    ignored: Counter[str] | None,
) -> pd.DataFrame:
    table, source = _table(path, (SEGMENT, TIME, OBJECT, TYPE, *CENTRE, *SIZE, HEADING)), str(path)
    of_box = integers(table, TIME, source)
    index = pd.Index(time).get_indexer(pd.Index(of_box))
    if (row := first(index < 0)) is not None:
        problem = f"no vehicle_pose of frame {of_box[row]}"
        raise InputError(problem, place=f"{source}: row {row}", key=TIME)
    classes = classify(types(table, source), class_map, rows_of(source), ignored)
    columns: dict[str, Any] = {"object_id": texts(table, OBJECT, source), "class": classes}
    boxes = in_frames(frames, index, columns | in_ego(table, source))
    for name, column in COUNTS.items():
        if name in table:
            boxes[column] = counts_if_known(table, name, source)
    return boxes


def in_ego(table: pd.DataFrame, source: str) -> dict[str, NDArray[np.float64]]:
    """Return columns of `GEOMETRY` from those of a table of Waymo: `CENTRE`, `SIZE` and `HEADING`.

    Raises ValueError that names file, row and value."""
    centre, size = numbers(table, CENTRE, source) - ORIGIN, sizes(table, SIZE, source)
    return geometry_of(centre, size, numbers(table, [HEADING], source)[:, 0])


def frame_names(table: pd.DataFrame, source: str) -> NDArray[np.object_]:
    """Name the frame of every row, `SEGMENT/TIME`; (rows,), text."""
    time = integers(table, TIME, source).astype(str).astype(object)
    return np.asarray(texts(table, SEGMENT, source) + "/" + time, object)


def types(table: pd.DataFrame, source: str) -> pd.Series:
    """Name the types; a number beyond those that are known is a category of its own."""
    names = list(WAYMO)
    numbered = integers(table, TYPE, source).tolist()
    named = (names[n] if 0 <= n < len(names) else str(n) for n in numbered)
    return pd.Series([*named], dtype=object)


def _table(path: Path, names: Sequence[str]) -> pd.DataFrame:
    table = read_parquet(path)
    check_columns(list(table.columns), names, str(path))
    return table.reset_index(drop=True)
