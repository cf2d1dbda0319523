"""Writes a small data set in the layout of the Argoverse 2 sensor data set."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

LEVEL = (1.0, 0.0, 0.0, 0.0)
POSE = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")


class Box(NamedTuple):
    timestamp_ns: int
    category: str
    translation: tuple
    size: tuple = (4.0, 2.0, 1.5)  # length, width, height
    rotation: tuple = LEVEL
    track: str = "022c398c"


class Log(NamedTuple):
    split: str
    name: str
    boxes: list
    poses: dict  # timestamp_ns -> (quaternion w x y z, translation)
    sweeps: tuple | list = ()  # empty: a log without its sensors
    mounts: dict | None = None  # sensor -> (quaternion w x y z, translation)


def write_argoverse(folder: Path, logs: list) -> Path:
    for log in logs:
        path = folder / log.split / log.name
        path.mkdir(parents=True)
        rows = [
            (b.timestamp_ns, b.track, b.category, *b.size, *b.rotation, *b.translation, 10)
            for b in log.boxes
        ]
        columns = ["timestamp_ns", "track_uuid", "category", "length_m", "width_m", "height_m"]
        annotations = pd.DataFrame(rows, columns=[*columns, *POSE, "num_interior_pts"])
        types = {"timestamp_ns": np.int64, "num_interior_pts": np.int64}
        annotations.astype(types).to_feather(path / "annotations.feather")
        poses = pd.DataFrame(
            [(time, *quaternion, *place) for time, (quaternion, place) in log.poses.items()],
            columns=["timestamp_ns", *POSE],
        )
        poses.to_feather(path / "city_SE3_egovehicle.feather")
        (path / "calibration").mkdir()
        if log.mounts:
            rows = [(name, *turned, *place) for name, (turned, place) in log.mounts.items()]
            pd.DataFrame(rows, columns=["sensor_name", *POSE]).to_feather(
                path / "calibration" / "egovehicle_SE3_sensor.feather"
            )
        for time in log.sweeps:
            sweep = path / "sensors" / "lidar" / f"{time}.feather"
            sweep.parent.mkdir(parents=True, exist_ok=True)
            points = {"x": [1.5], "y": [2.5], "z": [-0.3], "intensity": [24], "laser_number": [31]}
            pd.DataFrame(points | {"offset_ns": [0]}).to_feather(sweep)
    return folder
