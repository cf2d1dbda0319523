"""Rigs as nuScenes calibrates them: the tables `sensor` and `calibrated_sensor`.

See https://github.com/nutonomy/nuscenes-devkit/blob/master/docs/schema_nuscenes.md."""

import json
import uuid
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings
from lidarplace.configuration.settings import validated
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import OPTICAL, RigSensor, mount_of, named_like
from lidarplace.scenes.datasets.nuscenes_tables import read_table
from lidarplace.scenes.datasets.se3 import poses

PIXELS = (1600, 900)
_SOURCE = "camera_intrinsic; images of nuScenes are 1600 x 900"
DECIMALS = 9  # of metres and parts of a rotation, up to which two calibrations are one


def read_nuscenes_rig(folder: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the sensors, by channel; cameras have intrinsics, and images of the data set's size.

    Every recording has calibrations of its own. Where those of a channel differ, they are called
    `CHANNEL.TOKEN`, and `only` has to choose. Raises ValueError: a table is missing or wrong, or a
    channel is left with several calibrations."""
    sensor = read_table(folder / "sensor.json", ("channel", "modality"))
    columns = ["sensor_token", "translation", "rotation"]
    columns += ["camera_intrinsic"] if "camera" in sensor.columns["modality"] else []
    rows = read_table(folder / "calibrated_sensor.json", columns)
    owner = rows.rows_in(sensor, "sensor_token")
    kinds = np.array(sensor.columns["modality"], str)
    readable = np.isin(kinds, ("lidar", "camera", "radar"))
    rows, owner = rows.take(np.flatnonzero(readable[owner])), owner[readable[owner]]
    pose = poses(rows.numbers("translation", 3), rows.numbers("rotation", 4), rows.row)
    matrices = pose.rotation.as_matrix()
    camera = kinds[owner] == "camera"
    matrices[camera] = matrices[camera] @ OPTICAL.T
    numbers = np.column_stack([owner, pose.position, matrices.reshape(-1, 9)]).round(DECIMALS)
    different = np.sort(np.unique(numbers, axis=0, return_index=True)[1]).tolist()
    channels = {row: str(sensor.columns["channel"][owner[row]]) for row in different}
    often = Counter(channels.values())
    by_name = {
        channel if often[channel] == 1 else f"{channel}.{rows.columns['token'][row]}": row
        for row, channel in channels.items()
    }
    with at(folder):
        chosen = named_like(list(by_name), only)
    per_channel = Counter(channels[by_name[name]] for name in chosen)
    for name in chosen:
        if (number := per_channel[channel := channels[by_name[name]]]) > 1:
            wrong, fix = f"{number} different calibrations", f"choose one, such as --only {name}"
            raise InputError(wrong, place=rows.path, key=channel, fix=fix)
    rig = []
    for row in (by_name[name] for name in chosen):
        intrinsic: Any = rows.columns.get("camera_intrinsic", {row: []})[row]
        further = _further(kinds[owner[row]], intrinsic, f"{rows.path}: {channels[row]}")
        mount = mount_of(pose.position[row], matrices[row])
        rig.append(RigSensor(channels[row], mount, further=further))
    return rig


def _further(kind: str, intrinsic: Any, where: str) -> CameraSettings | RadarSettings | None:
    """Return the settings of a camera or a radar, without its pose; None of a LiDAR."""
    if kind == "lidar":
        return None
    if kind == "radar":
        return RadarSettings(z=0.0)
    values = {"intrinsic": intrinsic, "pixels": PIXELS, "source": _SOURCE} if intrinsic else {}
    return validated(CameraSettings, {"z": 0.0} | values, where)


def _intrinsic(sensor: RigSensor) -> list[list[float]]:
    """Return the intrinsics of a camera whose angles are known; none of others."""
    if not isinstance(sensor.further, CameraSettings):
        return []
    if sensor.further.intrinsic is not None:
        return [list(row) for row in sensor.further.intrinsic]
    if (camera := sensor.further.built()) is None:
        return []
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def write_nuscenes_rig(folder: Path, lidars: Sequence[RigSensor]) -> None:
    """Write the two tables into a folder. The tokens of a name are always the same."""
    sensors, calibrated = [], []
    for lidar in lidars:
        token = uuid.uuid5(uuid.NAMESPACE_URL, lidar.name).hex
        calibration = uuid.uuid5(uuid.NAMESPACE_URL, f"{lidar.name} calibrated").hex
        matrix = lidar.mount.rotation
        matrix = matrix @ OPTICAL if lidar.kind == "camera" else matrix
        quaternion = Rotation.from_matrix(matrix).as_quat()  # its real part last
        place, turned = lidar.mount.position.tolist(), np.roll(quaternion, 1).tolist()
        pose = {"translation": place, "rotation": turned, "camera_intrinsic": _intrinsic(lidar)}
        sensors.append({"token": token, "channel": lidar.name, "modality": lidar.kind})
        calibrated.append({"token": calibration, "sensor_token": token} | pose)
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in (("sensor", sensors), ("calibrated_sensor", calibrated)):
        write_text(folder / f"{name}.json", json.dumps(rows, indent=1))
