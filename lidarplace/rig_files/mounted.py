"""A sensor on a vehicle as files of rigs have it: a name, a pose, and maybe a model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel

from lidarplace.base.errors import InputError
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings
from lidarplace.configuration.record import Number
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rigs.further_sensors import Kind
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import angles

Vector = tuple[float, float, float]  # x, y, z in metres


@dataclass(frozen=True)
class RigSensor:
    """A LiDAR of a rig; or a camera or a radar, which files of rigs have, too."""

    name: str  # in the file
    mount: Mount  # in the vehicle frame of whoever has it; cameras look along its x axis
    model: SensorSettings | None = None
    further: CameraSettings | RadarSettings | None = None
    """Settings of a camera or a radar, as far as they are known; their pose is of no account."""

    @property
    def kind(self) -> Kind:
        """Kind of the sensor."""
        return "lidar" if self.further is None else self.further.KIND

    def moved(self, x: float, y: float, z: float) -> "RigSensor":
        """Return the sensor, farther by x, y, z in metres."""
        mount = self.mount
        # Rounded, as 1.9 - 0.3 would be written as 1.5999999999999999.
        x, y, z = (round(value, 12) for value in (mount.x + x, mount.y + y, mount.z + z))
        return replace(self, mount=replace(mount, x=x, y=y, z=z))


class Place(BaseModel):
    """Numbers of a pose in JSON; what is 0 may be left out."""

    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0
    roll: Number = 0.0
    pitch: Number = 0.0
    yaw: Number = 0.0


def mount_of(position: ArrayLike, matrix: NDArray[np.float64]) -> Mount:
    """Return the mount of a position, 3 metres, and a sensor-to-vehicle rotation, (3, 3)."""
    x, y, z = np.asarray(position, np.float64).tolist()
    return Mount(x, y, z, *angles(matrix))


def named_like(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Return the names that a pattern fits, whatever their case; all, without a pattern.

    `*` stands for any text. Raises ValueError if a pattern fits none of them."""
    matched = set(names) if not patterns else set()
    for pattern in patterns:
        fitting = [name for name in names if fnmatchcase(name.lower(), pattern.lower())]
        if not fitting:
            available, fix = ", ".join(names) or "none", "--only says which"
            raise InputError(f"no LiDAR is called {pattern}", found=available, fix=fix)
        matched |= {*fitting}
    return [name for name in names if name in matched]


def check_lidars(lidars: Sequence[RigSensor], source: str) -> None:
    """Raise ValueError if there is no LiDAR, or two sensors have one name."""
    if not lidars_in(lidars):
        raise InputError("no LiDAR", place=source)
    names = [lidar.name for lidar in lidars]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"duplicate sensor name {twice[0]}", place=source)


OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from the frame of an image, x to the right, y down, z ahead, to that of a mount."""


def of_frame(frame: RigSensor, further: CameraSettings | RadarSettings) -> RigSensor:
    """Return a frame as a camera or a radar; optical frames, by their name, as in REP 103."""
    mount = frame.mount
    if "optical" in frame.name and isinstance(further, CameraSettings):
        mount = mount_of(mount.position, mount.rotation @ OPTICAL.T)
    return replace(frame, mount=mount, further=further)


def mount_in_frame(sensor: RigSensor) -> Mount:
    """Return the mount of a sensor in the frame that `of_frame` reads."""
    if "optical" in sensor.name and sensor.kind == "camera":
        return mount_of(sensor.mount.position, sensor.mount.rotation @ OPTICAL)
    return sensor.mount


def lidars_in(sensors: Iterable[RigSensor]) -> list[RigSensor]:
    """Return the sensors that are LiDARs."""
    return [sensor for sensor in sensors if sensor.kind == "lidar"]


BASE = "base_link"
"""Frame of a vehicle, as ROS calls it (REP 105); in its place the root, if there is one."""


@dataclass(frozen=True)
class Joint:
    """A joint that holds a frame."""

    parent: str
    child: str
    position: NDArray[np.float64]  # of the child in its parent, metres
    rotation: NDArray[np.float64]  # child to parent, shape (3, 3)
    moves: str = ""  # how the child moves against its parent


def lidars_of(joints: Sequence[Joint], only: Sequence[str]) -> list[RigSensor]:
    """Return the frames that patterns name, in the frame of the vehicle.

    Raises ValueError: frames form no tree, no pattern is given or one fits no frame, or a frame of
    a LiDAR moves."""
    holds: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in holds:
            raise InputError(f"frame {joint.child} has two parents")
        holds[joint.child] = joint
    roots = list(dict.fromkeys(j.parent for j in joints if j.parent not in holds))
    base = BASE if BASE in holds or BASE in roots else roots[0] if len(roots) == 1 else None
    if base is None:
        listed = ", ".join(roots) or "none, because the frames form a cycle"
        raise InputError(f"no frame {BASE}, and not one root", found=listed)
    if not only:
        fix = "name them with --only (* matches any text)"
        raise InputError("no LiDARs selected", found=", ".join(holds), fix=fix)
    return [_placed(name, base, holds) for name in named_like(list(holds), only)]


def _placed(name: str, base: str, holds: Mapping[str, Joint]) -> RigSensor:
    position, matrix = np.zeros(3), np.eye(3)
    frame, steps = name, 0
    while frame != base:
        if frame not in holds or steps > len(holds):
            raise InputError(f"frame {name} does not hang from {base}")
        joint = holds[frame]
        if joint.moves:
            raise InputError(f"frame {name} hangs from a joint that is {joint.moves}")
        position = joint.position + joint.rotation @ position
        matrix = joint.rotation @ matrix
        frame, steps = joint.parent, steps + 1
    return RigSensor(name, mount_of(position, matrix))
