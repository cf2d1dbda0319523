"""Detections in each layout: a table of frame, category, box in the ego frame and score."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.detections.frames import LogFrames, Row
from lidarplace.files.columns import check_columns, frame_numbers, integers, numbers, sizes, texts
from lidarplace.files.json_file import read_json
from lidarplace.files.tables import read_feather
from lidarplace.logs.boxes import GEOMETRY, SIZE, SOURCE
from lidarplace.scenes.datasets import argoverse, nuscenes, waymo
from lidarplace.scenes.datasets.class_maps import ClassMap
from lidarplace.scenes.datasets.nuscenes_tables import Table
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.kitti.calibration import (
    LIDAR_HEIGHT_M,
    STANDARD,
    camera_to_ego,
    read_calibration,
)
from lidarplace.scenes.kitti.read import in_ego, read_labels

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

_BOX = ("translation", "size", "rotation", "detection_name", "detection_score")


class Found(NamedTuple):
    """Detections of a file.

    Attributes:
        table: `frame`, `category`, columns of `GEOMETRY` in the ego frame, `score`.
        row: names a row of it.
    """

    table: pd.DataFrame
    row: Row


def of_kitti(
    files: Sequence[Path],
    frames: LogFrames,
    types: ClassMap,
    ignored: Counter[str],
    calibration: Path | None,
    lidar_height: float = LIDAR_HEIGHT_M,
) -> Found:
    """Result files of KITTI, one a frame, lines of 16 fields, boxes in the camera's frame.

    Args:
        types: class map; what it ignores is counted in `ignored`.
        calibration: folder of a file a frame; None: the camera of our own export.
        lidar_height: with `calibration`: of the LiDAR above the ground, metres.
    """
    places, names, values, cameras, numbered = [], [], [], [], []
    standard = camera_to_ego(STANDARD)
    of_files = frames.named([path.stem for path in files], lambda at: str(files[at])).tolist()
    for path, frame in zip(files, of_files, strict=True):
        camera = standard
        if calibration is not None:
            camera = camera_to_ego(read_calibration(calibration / path.name), lidar_height)
        for line, name, fields in read_labels(path, types, ignored, None, (16,)):
            places.append((path, line))
            names.append(name)
            values.append(fields)
            cameras.append(camera)
            numbered.append(frame)
    array = np.array(values, np.float64).reshape(-1, 15)
    boxes = in_ego(array[:, 7:14], np.array(cameras, np.float64).reshape(-1, 3, 4))
    table = pd.DataFrame({"frame": np.array(numbered, np.int64), "category": names})
    table = table.assign(**boxes, score=array[:, 14])
    return Found(table, lambda at: "{}: line {}".format(*places[at]))


def of_nuscenes(path: Path, frames: LogFrames) -> Found:
    """The JSON file of nuScenes' detection challenge: boxes in the world by sample."""
    content = read_json(path)
    results = content.get("results") if isinstance(content, dict) else None
    if not isinstance(results, dict):
        raise InputError("no detections", place=str(path), expected='{"results": {SAMPLE: [BOX]}}')
    tokens = list(results)
    of_sample = frames.named(tokens, lambda at: f"{path}: sample {tokens[at]}")
    columns: dict[str, list[Any]] = {name: [] for name in ("token", *_BOX)}
    frame = []
    for token, number in zip(tokens, of_sample.tolist(), strict=True):
        boxes = results[token]
        if not isinstance(boxes, list):
            raise InputError("no list of boxes", place=f"{path}: sample {token}")
        for at, box in enumerate(boxes):
            missing = [name for name in _BOX if not isinstance(box, dict) or name not in box]
            if missing:
                place = f"{path}: token {token}: box {at}"
                raise InputError("missing key", place=place, key=", ".join(missing))
            if box.get("sample_token", token) != token:
                place, other = f"{path}: token {token}: box {at}", str(box["sample_token"])
                raise InputError(
                    "box of another sample", place=place, key="sample_token", found=other
                )
            frame.append(number)
            columns["token"].append(f"{token}: box {at}")
            for name in _BOX:
                columns[name].append(box[name])
    table = Table(path, columns)
    numbered = np.array(frame, np.int64)
    named = columns["detection_name"]
    boxes = nuscenes.in_ego(table, frames.ego(numbered, table.row, full=True))
    category = [CATEGORIES.get(name, name) if isinstance(name, str) else name for name in named]
    own = pd.DataFrame({"frame": numbered, "category": pd.Series(category, dtype=object)})
    return Found(own.assign(**boxes, score=table.numbers("detection_score")), table.row)


def of_argoverse(path: Path, frames: LogFrames) -> Found:
    """The Feather file of Argoverse 2's detection challenge: boxes in its ego frame."""
    geometry = (*argoverse.TRANSLATION, *argoverse.SIZE, *argoverse.QUATERNION)
    table = read_feather(path, ("log_id", "timestamp_ns", "category", "score", *geometry))
    time = integers(table, "timestamp_ns", str(path)).astype(str).astype(object)
    names = texts(table, "log_id", str(path)) + "/" + time
    boxes = argoverse.in_ego(table, str(path))
    return _of_table(table, path, frames.named(names, _row(path)), boxes, "category")


def of_waymo(table: pd.DataFrame, path: Path, frames: LogFrames) -> Found:
    """A table of Waymo's columns of `lidar_box` and `score`: boxes in its vehicle frame."""
    geometry = (*waymo.CENTRE, *waymo.SIZE, waymo.HEADING)
    names = (waymo.SEGMENT, waymo.TIME, waymo.TYPE, *geometry, "score")
    check_columns(list(table.columns), names, str(path))
    frame = frames.named(waymo.frame_names(table, str(path)), _row(path))
    table = table.assign(category=waymo.types(table, str(path)))
    return _of_table(table, path, frame, waymo.in_ego(table, str(path)), "category")


def of_parquet(table: pd.DataFrame, path: Path, frames: LogFrames, world: bool) -> Found:
    """A table of our columns: `frame` or `source`, `class`, `GEOMETRY`, `score`.

    Args:
        world: whether boxes are in the world, not in the ego frame.
    """
    by = SOURCE if SOURCE in table else "frame"
    check_columns(list(table.columns), (by, "class", *GEOMETRY, "score"), str(path))
    if by == SOURCE:
        frame = frames.named(texts(table, SOURCE, str(path)), _row(path))
    else:
        frame = frames.numbered(frame_numbers(table, str(path)), _row(path))
    values = numbers(table, GEOMETRY, str(path))
    sizes(table, SIZE, str(path))
    boxes = dict(zip(GEOMETRY, values.T, strict=True))
    if world:
        turned = np.zeros((len(values), 3))
        turned[:, 2] = values[:, 6]
        posed = Poses(values[:, :3], Rotation.from_rotvec(turned))
        posed = posed.seen_from(frames.ego(frame, _row(path), full=False))
        boxes |= dict(zip("xyz", posed.position.T, strict=True)) | {"yaw": posed.yaw}
    return _of_table(table, path, frame, boxes, "class")


def _of_table(
    table: pd.DataFrame, path: Path, frame: Any, boxes: dict[str, Any], category: str
) -> Found:
    score = numbers(table, ["score"], str(path))[:, 0]
    own = {"frame": frame, "category": table[category].to_numpy(object), **boxes, "score": score}
    return Found(pd.DataFrame(own), _row(path))


def _row(path: Path) -> Row:
    return lambda at: f"{path}: row {at}"
