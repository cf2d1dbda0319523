"""Rigs as Autoware calibrates them: `sensors_calibration.yaml` and `sensor_kit_calibration.yaml`.

https://github.com/autowarefoundation/sample_sensor_kit_launch has an example."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import yaml

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.settings import excerpt, validated
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import BASE, Joint, Place, RigSensor, lidars_of, mount_in_frame
from lidarplace.rigs.placement import Mount

FILES = ("sensors_calibration.yaml", "sensor_kit_calibration.yaml")


def read_autoware(path: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the frames that are LiDARs, see `lidars_of`, of a folder, or of a file and its pair.

    Poses are those of the frames that the files name, such as `velodyne_top_base_link`; where the
    LiDAR is in that frame is said by its own description. Raises ValueError: files are missing or
    invalid, or frames are not of a vehicle."""
    folder = path if path.is_dir() else path.parent
    files = [folder / name for name in FILES if (folder / name).is_file()]
    files += [path] * (path.is_file() and path not in files)
    if not files:
        raise InputError(place=folder, expected=" or ".join(FILES))
    joints = []
    for file in files:
        content = read_yaml_file(file)
        if not isinstance(content, dict):
            raise InputError(place=file, expected="frames by parent", found=excerpt(content))
        for parent, children in content.items():
            frames = validated(dict[str, Place], children, f"{file}: {parent}")
            for child, place in frames.items():
                with at(f"{file}: {child}"):
                    mount = Mount(**place.model_dump())
                joints.append(Joint(str(parent), child, mount.position, mount.rotation))
    if BASE not in {joint.parent for joint in joints}:
        fix = f"add {FILES[0]}, which places the kit on the vehicle"
        raise InputError(f"no frame {BASE}", place=folder, fix=fix)
    with at(folder):
        return lidars_of(joints, only)


def write_autoware(path: Path, sensors: Sequence[RigSensor]) -> None:
    """Write `sensors_calibration.yaml`, with every sensor in `base_link`."""
    frames = {sensor.name: asdict(mount_in_frame(sensor)) for sensor in sensors}
    write_text(path, yaml.safe_dump({BASE: frames}, sort_keys=False))
