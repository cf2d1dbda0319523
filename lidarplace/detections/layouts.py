"""Detections in each layout, as a table: frame, category, box in the ego frame, score."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns, frame_numbers, integers, numbers, texts
from lidarplace.files.json_file import read_json
from lidarplace.files.tables import read_feather, read_parquet
from lidarplace.logs.boxes import GEOMETRY, SOURCE, first, full_poses, rows_of
from lidarplace.scenes.datasets import argoverse, class_maps, nuscenes, waymo
from lidarplace.scenes.datasets.class_maps import ClassMap
from lidarplace.scenes.datasets.nuscenes_tables import TokenTable
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.kitti.calibration import STANDARD, camera_to_ego, read_calibration
from lidarplace.scenes.kitti.read import frame_name, in_ego, read_labels

CATEGORIES = {
    "barrier": "movable_object.barrier",
    "bicycle": "vehicle.bicycle",
    "bus": "vehicle.bus.rigid",
    "car": "vehicle.car",
    "construction_vehicle": "vehicle.construction",
    "motorcycle": "vehicle.motorcycle",
    "pedestrian": "human.pedestrian.adult",
    "traffic_cone": "movable_object.trafficcone",
    "trailer": "vehicle.trailer",
    "truck": "vehicle.truck",
}
"""The ten names of nuScenes' detection challenge -> a category of its boxes."""
Row = Callable[[int], str]
"""File and row of a detection, for messages."""
_BOX = ("translation", "size", "rotation", "detection_name", "detection_score")


class DetectionTable(NamedTuple):
    """Detections of a file."""

    table: pd.DataFrame  # `frame`, `category`, columns of `GEOMETRY` in the ego frame, `score`
    row: Row  # names a row of it
    class_map: ClassMap  # of the layout


class LogFrames:
    """Frames of a log by number, by their `SOURCE`, and by their number as KITTI writes it.

    Raises InputError if two frames have one name."""

    def __init__(self, frames: pd.DataFrame) -> None:
        self._frames, numbers = frames, frames["frame"].tolist()
        self._numbers: dict[str | int, int] = {number: number for number in numbers}
        self._numbers |= {frame_name(number): number for number in numbers}
        if SOURCE in frames:
            if (twice := first(frames[SOURCE].duplicated())) is not None:
                name = frames[SOURCE].iloc[twice]
                raise InputError("duplicate name of a frame", place="log", key=SOURCE, found=name)
            self._numbers |= dict(zip(frames[SOURCE].tolist(), numbers, strict=True))

    def named(self, names: Iterable[str | int], row: Row) -> NDArray[np.int64]:
        """Return the numbers of named frames; (rows,).

        Raises InputError for an unknown one."""
        numbers = []
        for at, name in enumerate(names):
            if name not in self._numbers:
                similar = [key for key in self._numbers if isinstance(key, type(name))]
                such = f"a frame of the log, such as {similar[-1]}" if similar else "a frame"
                fix = "" if SOURCE in self._frames else "`convert` keeps the names of the source"
                raise InputError("unknown frame", place=row(at), expected=such, found=name, fix=fix)
            numbers.append(self._numbers[name])
        return np.array(numbers, np.int64)

    def ego(self, numbers: NDArray[np.int64], row: Row) -> Poses:
        """Return the poses of the vehicle in the world in these frames; (rows,).

        Raises InputError if the log has none."""
        poses, rotations, positions = full_poses(self._frames), [], []
        for at, number in enumerate(numbers.tolist()):
            if number not in poses:
                problem = "the log has no pose of the vehicle"
                raise InputError(problem, place=row(at), key="frame", found=number)
            rotations.append(poses[number][0])
            positions.append(poses[number][1])
        turns = Rotation.from_matrix(np.reshape(rotations, (-1, 3, 3)))
        return Poses(np.reshape(positions, (-1, 3)), turns)


def of_kitti(
    files: Sequence[Path],
    frames: LogFrames,
    types: ClassMap,
    ignored: Counter[str],
    calibration: Path | None,
    lidar_height: float,
) -> DetectionTable:
    """Read result files of KITTI, one a frame, lines of 16 fields, boxes in the camera's frame.

    `calibration` has a file a frame, with a LiDAR at `lidar_height`; None: our own export's camera.
    """
    rows: list[tuple[int, Path, int, str]] = []
    values, cameras, camera = [], [], camera_to_ego(STANDARD)
    numbered = frames.named((path.stem for path in files), lambda at: str(files[at]))
    for path, frame in zip(files, numbered.tolist(), strict=True):
        if calibration is not None:
            camera = camera_to_ego(read_calibration(calibration / path.name), lidar_height)
        for line, name, fields in read_labels(path, types, ignored, None, (16,)):
            rows.append((frame, path, line, name))
            values.append(fields)
            cameras.append(camera)
    array = np.array(values, np.float64).reshape(-1, 15)
    boxes = in_ego(array[:, 7:14], np.array(cameras, np.float64).reshape(-1, 3, 4))
    table = pd.DataFrame(rows, columns=["frame", "path", "line", "category"])
    table = table.assign(**boxes, score=array[:, 14])
    return DetectionTable(table, lambda at: f"{rows[at][1]}: line {rows[at][2]}", class_maps.KITTI)


def of_nuscenes(path: Path, frames: LogFrames) -> DetectionTable:
    """Read the JSON file of nuScenes' detection challenge: boxes in the world by sample."""
    content = read_json(path)
    results = content.get("results") if isinstance(content, dict) else None
    if not isinstance(results, dict):
        raise InputError("no detections", place=path, expected='{"results": {SAMPLE: [BOX]}}')
    of_sample = frames.named(results, lambda at: f"{path}: sample {[*results][at]}")
    columns: dict[str, list[Any]] = {name: [] for name in ("frame", "token", *_BOX)}
    for (token, boxes), number in zip(results.items(), of_sample.tolist(), strict=True):
        if not isinstance(boxes, list):
            raise InputError("no list of boxes", place=f"{path}: sample {token}")
        for at, box in enumerate(boxes):
            missing = [name for name in _BOX if not isinstance(box, dict) or name not in box]
            if missing or box.get("sample_token", token) != token:
                problem = "missing key" if missing else "box of another sample"
                key = ", ".join(missing) or "sample_token"
                raise InputError(problem, place=f"{path}: token {token}: box {at}", key=key)
            row = {**box, "frame": number, "token": f"{token}: box {at}"}
            for name, values in columns.items():
                values.append(row[name])
    frame, names = np.array(columns.pop("frame"), np.int64), columns["detection_name"]
    table = TokenTable(path, columns)
    boxes = nuscenes.in_ego(table, frames.ego(frame, table.row))
    category = [CATEGORIES.get(name, name) if isinstance(name, str) else name for name in names]
    detections = pd.DataFrame({"frame": frame, "category": pd.Series(category, dtype=object)})
    detections = detections.assign(**boxes, score=table.numbers("detection_score"))
    return DetectionTable(detections, table.row, class_maps.NUSCENES)


def of_argoverse(path: Path, frames: LogFrames) -> DetectionTable:
    """Read the Feather file of Argoverse 2's detection challenge: boxes in its ego frame."""
    geometry = (*argoverse.TRANSLATION, *argoverse.SIZE, *argoverse.QUATERNION)
    table = read_feather(path, ("log_id", "timestamp_ns", "category", "score", *geometry))
    time = integers(table, "timestamp_ns", str(path)).astype(str).astype(object)
    names = texts(table, "log_id", str(path)) + "/" + time
    boxes = argoverse.in_ego(table, str(path))
    return _rows(path, frames, names, table["category"], boxes, table, class_maps.ARGOVERSE)


def of_parquet(path: Path, frames: LogFrames, as_waymo: bool | None, world: bool) -> DetectionTable:
    """Read a Parquet table of Waymo's columns of `lidar_box` and `score`, or of ours.

    Waymo's boxes are in its vehicle frame. Our columns are `frame` or `source`, `class`,
    `GEOMETRY`, `score`, in the ego frame or the `world`. `as_waymo` selects between them; None: by
    the columns."""
    table, source = read_parquet(path).reset_index(drop=True), str(path)
    names: NDArray[Any]
    if waymo.SEGMENT in table if as_waymo is None else as_waymo:
        geometry = (*waymo.CENTRE, *waymo.SIZE, waymo.HEADING, "score")
        keys = (waymo.SEGMENT, waymo.TIME, waymo.TYPE)
        check_columns(list(table.columns), (*keys, *geometry), source)
        names, kinds = waymo.frame_names(table, source), waymo.types(table, source)
        boxes = waymo.in_ego(table, source)
        return _rows(path, frames, names, kinds, boxes, table, class_maps.WAYMO)
    by = SOURCE if SOURCE in table else "frame"
    check_columns(list(table.columns), (by, "class", *GEOMETRY, "score"), source)
    names = texts(table, by, source) if by == SOURCE else frame_numbers(table, source)
    values = numbers(table, GEOMETRY, source)
    boxes = dict(zip(GEOMETRY, values.T, strict=True))
    rows = _rows(path, frames, names, table["class"], boxes, table, class_maps.BOX_LOG)
    if world:
        ego = frames.ego(rows.table["frame"].to_numpy(np.int64), rows.row)
        posed = Poses.of_boxes(rows.table).seen_from(ego)
        boxes = dict(zip("xyz", posed.position.T, strict=True)) | {"yaw": posed.yaw}
        return rows._replace(table=rows.table.assign(**boxes))
    return rows


def _rows(
    path: Path,
    frames: LogFrames,
    names: NDArray[Any],
    categories: pd.Series,
    boxes: dict[str, NDArray[np.float64]],
    table: pd.DataFrame,
    class_map: ClassMap,
) -> DetectionTable:
    row = rows_of(path)
    columns = {"frame": frames.named(names.tolist(), row), "category": categories.to_numpy(object)}
    score = numbers(table, ["score"], str(path))[:, 0]
    return DetectionTable(pd.DataFrame({**columns, **boxes, "score": score}), row, class_map)
