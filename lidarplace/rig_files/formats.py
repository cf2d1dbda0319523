"""The table of the formats that rigs are read from and written to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.rig_files.autoware import FILES, read_autoware, write_autoware
from lidarplace.rig_files.carla import read_carla, write_carla
from lidarplace.rig_files.mounted import RigSensor, Vector
from lidarplace.rig_files.nuscenes import read_nuscenes_rig, write_nuscenes_rig
from lidarplace.rig_files.osi import read_osi, write_osi
from lidarplace.rig_files.ros2 import read_ros2, write_ros2
from lidarplace.rig_files.urdf import read_urdf, write_urdf
from lidarplace.scenes.datasets.nuscenes import ORIGIN


@dataclass(frozen=True)
class RigFormat:
    """Format in which another tool writes a rig."""

    read: Callable[[Path, Sequence[str]], list[RigSensor]]
    """Reads the sensors at a path whose names fit patterns, in the file's vehicle frame."""
    write: Callable[[Path, Sequence[RigSensor]], None]
    origin: Vector | None = None
    """Origin of the file's vehicle frame in our ego frame, metres; None: it may be anywhere.
    Axes are ours in all of them."""
    suffixes: tuple[str, ...] = ()  # by which it is known, without a name
    frames: bool = False  # whether it holds frames of all kinds: what each is has to be told
    lidars_alone: bool = False  # whether cameras and radars have no place in it


FORMATS = {
    "nuscenes": RigFormat(
        read_nuscenes_rig, write_nuscenes_rig, (0 - ORIGIN[0], 0 - ORIGIN[1], 0 - ORIGIN[2])
    ),
    "urdf": RigFormat(read_urdf, write_urdf, suffixes=(".urdf",), frames=True),
    "ros2": RigFormat(read_ros2, write_ros2, suffixes=(".launch.xml", ".launch"), frames=True),
    "carla": RigFormat(read_carla, write_carla, (0.0, 0.0, 0.0), lidars_alone=True),
    "osi": RigFormat(read_osi, write_osi),
    "autoware": RigFormat(read_autoware, write_autoware, suffixes=FILES, frames=True),
}
"""Formats by name."""
PROGRAMS = {
    ".launch.py": "launch it, and pass its robot: `ros2 param get --hide-type "
    "/robot_state_publisher robot_description > car.urdf`",
    ".xacro": "run `xacro FILE > car.urdf`, and pass that",
}
"""What makes a file that can be read of one that is a program, by suffix."""


def format_of(path: Path, name: str | None) -> RigFormat:
    """Return the format of that name, or the one of a file; ValueError if there is none."""
    if name is not None:
        if name not in FORMATS:
            raise InputError(place="--format", expected=f"one of {', '.join(FORMATS)}", found=name)
        return FORMATS[name]
    for candidate in FORMATS.values():
        if path.name.endswith(candidate.suffixes or "\n"):
            return candidate
    for suffix, fix in PROGRAMS.items():
        if path.name.endswith(suffix):
            raise InputError("a program, which is not executed", place=path, fix=fix)
    fix = f"name it with --format {'|'.join(FORMATS)}"
    raise InputError("unknown format", place=path, fix=fix)
