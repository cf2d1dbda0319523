"""Rigs as nuScenes calibrates them: the tables `sensor` and `calibrated_sensor`.

https://github.com/nutonomy/nuscenes-devkit/blob/master/docs/schema_nuscenes.md
"""

import json
import uuid
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import MountedLidar, mount_of, named_like
from lidarplace.scenes.datasets.nuscenes_tables import read_table
from lidarplace.scenes.datasets.se3 import poses

DECIMALS = 9
"""Of metres and parts of a rotation, up to which two calibrations are one."""


def read_nuscenes_rig(folder: Path, only: Sequence[str]) -> list[MountedLidar]:
    """The sensors of modality lidar, by channel.

    Every recording has calibrations of its own. Where those of a channel differ, they are called
    `CHANNEL.TOKEN`, and `only` has to choose.

    Raises:
        ValueError: a table is missing or wrong, or a channel is left with several calibrations.
    """
    sensor = read_table(folder / "sensor.json", ("channel", "modality"))
    rows = read_table(
        folder / "calibrated_sensor.json", ("sensor_token", "translation", "rotation")
    )
    owner = rows.rows_in(sensor, "sensor_token")
    lidar = np.array([kind == "lidar" for kind in sensor.columns["modality"]], bool)
    rows, owner = rows.take(np.flatnonzero(lidar[owner])), owner[lidar[owner]]
    pose = poses(rows.numbers("translation", 3), rows.numbers("rotation", 4), rows.row)
    matrices = pose.rotation.as_matrix()
    numbers = np.column_stack([owner, pose.position, matrices.reshape(-1, 9)]).round(DECIMALS)
    different = np.sort(np.unique(numbers, axis=0, return_index=True)[1]).tolist()
    channels = {row: str(sensor.columns["channel"][owner[row]]) for row in different}
    often = Counter(channels.values())
    by_name = {
        channel if often[channel] == 1 else f"{channel}.{rows.columns['token'][row]}": row
        for row, channel in channels.items()
    }
    chosen = named_like(list(by_name), only, str(folder))
    found = Counter(channels[by_name[name]] for name in chosen)
    for channel, number in found.items():
        if number > 1:
            (first, *_) = (name for name in chosen if channels[by_name[name]] == channel)
            raise ValueError(
                f"{rows.path}: {channel} has {number} different calibrations; choose one, such as "
                f"--only {first}"
            )
    return [
        MountedLidar(channels[row], mount_of(pose.position[row], matrices[row]))
        for row in (by_name[name] for name in chosen)
    ]


def write_nuscenes_rig(folder: Path, lidars: Sequence[MountedLidar]) -> None:
    """Write the two tables into a folder. The tokens of a name are always the same."""
    sensors, calibrated = [], []
    for lidar in lidars:
        token = uuid.uuid5(uuid.NAMESPACE_URL, lidar.name).hex
        quaternion = Rotation.from_matrix(lidar.mount.rotation).as_quat()  # its real part last
        sensors.append({"token": token, "channel": lidar.name, "modality": "lidar"})
        calibrated.append(
            {
                "token": uuid.uuid5(uuid.NAMESPACE_URL, f"{lidar.name} calibrated").hex,
                "sensor_token": token,
                "translation": lidar.mount.position.tolist(),
                "rotation": np.roll(quaternion, 1).tolist(),
                "camera_intrinsic": [],
            }
        )
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in (("sensor", sensors), ("calibrated_sensor", calibrated)):
        write_text(folder / f"{name}.json", json.dumps(rows, indent=1))
