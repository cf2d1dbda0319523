"""Box logs of OPV2V: vehicles of CARLA, each with a LiDAR of its own.

https://github.com/DerrickXuNu/OpenCOOD describes the files and has the transform of the boxes. The
axes are CARLA's, left-handed, and extents are half of the sizes."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError, at
from lidarplace.clouds.cloud_files import CloudFile
from lidarplace.configuration.record import Number
from lidarplace.configuration.settings import validated
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.files.regular import is_there
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, SOURCE, geometry_of
from lidarplace.logs.convention import CARLA_AXES, Convention
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.pose import from_carla, rotation
from lidarplace.scenes.datasets.class_maps import ClassMap, classify, merged
from lidarplace.scenes.datasets.drives import (
    Drive,
    Models,
    drives_in,
    in_frames,
    join_drives,
    models_of,
    recorded_rig,
)
from lidarplace.scenes.datasets.se3 import Poses

CONVENTION = replace(Convention.of(CARLA_AXES), size=2.0)
SPLITS = {"train": "train", "validate": "test", "test": "test", "test_culvercity": "test"}
"""Folder of the data set -> split of the box log."""
CATEGORY, CLASSES = "vehicle", {"vehicle": "Car"}
"""OPV2V has no categories: cars, vans and trucks are vehicles."""
LIDAR = "lidar"
_Three = Annotated[list[Number], Field(min_length=3, max_length=3)]
_Pose = Annotated[list[Number], Field(min_length=6, max_length=6)]
"""x, y, z, roll, yaw and pitch in CARLA's map, metres and degrees."""


class _Vehicle(BaseModel):
    location: _Three
    center: _Three  # added to the location, in the axes of the map
    extent: Annotated[list[Annotated[Number, Field(ge=0)]], Field(min_length=3, max_length=3)]
    angle: _Three  # roll, yaw and pitch, degrees


class _Frame(BaseModel):
    lidar_pose: _Pose
    true_ego_pos: _Pose
    vehicles: dict[int | str, _Vehicle] | None


class _Sensor(BaseModel):
    channels: Annotated[int, Field(ge=1, le=4096)]
    points_per_second: Annotated[Number, Field(gt=0)]
    rotation_frequency: Annotated[Number, Field(gt=0)]
    upper_fov: Number
    lower_fov: Number
    range: Annotated[Number, Field(gt=0)]

    def lidar(self) -> Lidar:
        steps = round(self.points_per_second / (self.channels * self.rotation_frequency))
        angles = (self.lower_fov, self.upper_fov)
        return Lidar.even(self.channels, angles, steps, range=self.range)


def read_opv2v(
    folder: Path,
    ignored: Counter[str],
    *,
    class_map: ClassMap | None = None,
    keep_ignored: bool = False,
    lidar: Models = None,
    splits: Sequence[str] = (),
) -> BoxLog:
    """OPV2V: YAML files of CARLA's vehicles; train stays train, the others become test.

    A scene and a route is a vehicle with a LiDAR in a scenario, `SCENARIO/VEHICLE`; a frame is a
    file. Boxes are those that the vehicle's LiDAR hits, as the files have them. Our origin is that
    of the vehicle in CARLA.

    `splits` are of `SPLITS`; without any `train` and `validate` are meant, or the one that is
    there. `lidar` is the model; None: as `data_protocol.yaml` of the scenario describes it.
    `class_map` and `keep_ignored` are those of `read_nuscenes`, for the category `vehicle`.

    Raises ValueError if a file is missing or wrong."""
    drives = drives_in(folder, splits, SPLITS, "*/*/", "folders SCENARIO/VEHICLE")
    classes = merged(CLASSES, class_map, keep_ignored)
    return join_drives(drives, lambda path, start: _drive(path, start, classes, ignored, lidar))


def _drive(
    path: Path, start: int, classes: ClassMap, ignored: Counter[str], lidar: Models
) -> Drive:
    if not path.name.isdecimal():
        fix = "remove it: only vehicles are read, no roadside units"
        raise InputError(place=path, expected="the number of a vehicle", fix=fix)
    files = [file for file in sorted(path.glob("*.yaml")) if re.fullmatch(r"\d+", file.stem)]
    if not files:
        raise InputError(place=path, expected="files such as 000069.yaml")
    frames = [validated(_Frame, read_yaml_file(file), str(file)) for file in files]
    model, step = _protocol(path.parent / "data_protocol.yaml")
    ticks = np.array([int(file.stem) for file in files])
    ego = _poses([frame.true_ego_pos for frame in frames])
    sensors = _poses([frame.lidar_pose for frame in frames]).seen_from(ego)
    to_ego = sensors.matrices()
    to_ego[:, :, :3] = to_ego[:, :, :3] @ CONVENTION.matrix
    name = f"{path.parent.name}/{path.name}"
    clouds = [f"{path.parent.parent.name}/{name}/{file.stem}.pcd" for file in files]
    table = pd.DataFrame(
        {
            "scene": name,
            "frame": start + np.arange(len(files)),
            "timestamp_s": (ticks - ticks[0]) * step,
            **ego.ego_columns(),
            CLOUD: [(CloudFile(*each, LIDAR),) for each in zip(clouds, to_ego, strict=True)],
            SOURCE: [f"{name}/{file.stem}" for file in files],
        }
    )
    lidars = models_of([LIDAR], lidar, {} if model is None else {LIDAR: model})
    rig = recorded_rig("opv2v", [LIDAR], sensors[np.array([0])], lidars)
    return _boxes(frames, table, ego, classes, ignored), table, rig


def _protocol(path: Path) -> tuple[Lidar | None, float]:
    """Return the model of the LiDARs, None where it is unknown, and seconds of a tick, or NaN."""
    content = read_yaml_file(path) if is_there(path) else {}
    sensor, step = content, content
    for key in ("vehicle_base", "sensing", "perception", "lidar"):
        sensor = sensor.get(key) if isinstance(sensor, dict) else None
    for key in ("world", "fixed_delta_seconds"):
        step = step.get(key) if isinstance(step, dict) else None
    seconds = np.nan if step is None else validated(Number, step, f"{path}: fixed_delta_seconds")
    with at(path):
        model = None if sensor is None else validated(_Sensor, sensor, str(path)).lidar()
    return model, float(seconds)


def _boxes(
    frames: Sequence[_Frame],
    table: pd.DataFrame,
    ego: Poses,
    classes: ClassMap,
    ignored: Counter[str],
) -> pd.DataFrame:
    of_box = [
        (row, number, vehicle)
        for row, frame in enumerate(frames)
        for number, vehicle in (frame.vehicles or {}).items()
    ]
    rows = np.array([row for row, _, _ in of_box], np.int64)
    vehicles = [vehicle for _, _, vehicle in of_box]
    centres = [[*np.add(each.location, each.center), *each.angle] for each in vehicles]
    pose = _poses(centres).seen_from(ego[rows])
    size = np.array([each.extent for each in vehicles]).reshape(-1, 3) * CONVENTION.size
    categories = pd.Series([CATEGORY] * len(of_box), dtype=object)
    columns = {
        "object_id": [str(number) for _, number, _ in of_box],
        "class": classify(categories, classes, lambda row: str(table[SOURCE].iloc[row]), ignored),
        **geometry_of(pose.position, size, pose.yaw),
    }
    return in_frames(table, rows, columns)


def _poses(values: Sequence[Sequence[float]]) -> Poses:
    """Return poses in our axes of x, y, z, roll, yaw and pitch in CARLA's."""
    poses: NDArray[np.float64] = np.array(values, np.float64).reshape(-1, 6)
    turns = np.empty((len(poses), 3, 3))
    for turn, (roll, yaw, pitch) in zip(turns, np.radians(poses[:, 3:]), strict=True):
        turn[:] = rotation(*from_carla(0.0, 0.0, 0.0, roll, pitch, yaw)[3:])
    return Poses(CONVENTION.places(poses[:, :3]), Rotation.from_matrix(turns))
