"""Rigs as static transforms of ROS: nodes `static_transform_publisher` of an XML launch file.

With either way to write arguments (https://docs.ros.org/en/rolling/p/tf2_ros), and that of ROS 1's
package tf, whose last argument is a period (https://wiki.ros.org/tf#static_transform_publisher)."""

import math
import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from lidarplace.base.errors import InputError, at
from lidarplace.files.xml import read_xml, write_xml
from lidarplace.rig_files.mounted import BASE, Joint, RigSensor, lidars_of, mount_in_frame
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.rotations import rotations

PUBLISHER = "static_transform_publisher"
PLACE = ("x", "y", "z")
ANGLES = ("roll", "pitch", "yaw")
QUATERNION = ("qx", "qy", "qz", "qw")
FRAMES = ("frame-id", "child-frame-id")
BY_ORDER = {
    len(names): names
    for names in ((*PLACE, "yaw", "pitch", "roll", *FRAMES), (*PLACE, *QUATERNION, *FRAMES))
}
"""Names of arguments without names, by their number. Angles begin with yaw."""
PACKAGES = ("tf2_ros", "tf")


def read_ros2(path: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the frames that are LiDARs, see `lidars_of`.

    The file is read, not launched: substitutions and conditions are rejected. Raises ValueError: it
    is not a launch file, a transform is invalid, or frames are not of a vehicle."""
    root = read_xml(path)
    with at(path):
        if root.tag != "launch":
            raise InputError("not an XML launch file", expected="the root launch", found=root.tag)
        nodes = [
            node for node in root.iter("node") if PUBLISHER in (node.get("exec"), node.get("type"))
        ]
        if not nodes:
            raise InputError(f"no node {PUBLISHER}")
        return lidars_of([_joint(node, n) for n, node in enumerate(nodes)], only)


def _joint(node: Element, number: int) -> Joint:
    text = node.get("args", "")
    with at(f"transform {number}"):
        if "$(" in text or node.get("if") or node.get("unless"):
            raise InputError("$(…), if and unless are not supported", fix="expand them")
        try:
            words = shlex.split(text)
        except ValueError as error:
            raise InputError(f"{error}: {text!r}", key="args") from None
        if (package := node.get("pkg")) not in PACKAGES:
            expected = " or ".join(PACKAGES)
            raise InputError(f"unknown package of {PUBLISHER}", expected=expected, found=package)
        arguments = _by_name(words[:-1] if package == "tf" else words)
        for name in FRAMES:
            if name not in arguments:
                raise InputError(f"no --{name} in {text!r}")
        numbers = {n: _number(n, word) for n, word in arguments.items() if n not in FRAMES}
        position = np.array([numbers.get(name, 0.0) for name in PLACE])
        quaternion = [numbers.get(name, float(name == "qw")) for name in QUATERNION]
        if set(arguments) & set(QUATERNION):
            matrix = rotations(quaternion).as_matrix()
        else:
            angles = [numbers.get(name, 0.0) for name in ANGLES]
            matrix = Mount(*position, *angles).rotation
        parent, child = (arguments[name].removeprefix("/") for name in FRAMES)
        return Joint(parent, child, position, matrix)


def _by_name(words: Sequence[str]) -> dict[str, str]:
    """Return arguments by name; both ways to write them."""
    if not any(word.startswith("--") for word in words):
        if len(words) not in BY_ORDER:
            needed = "x y z yaw pitch roll or x y z qx qy qz qw, and two frames"
            raise InputError(key="args", expected=needed, found=f"{len(words)} arguments")
        return dict(zip(BY_ORDER[len(words)], words, strict=True))
    allowed = (*PLACE, *ANGLES, *QUATERNION, *FRAMES)
    arguments = dict(zip(words[::2], words[1::2], strict=False))
    for name in arguments:
        if not name.startswith("--") or name[2:] not in allowed:
            raise InputError(key="args", expected=f"--{', --'.join(allowed)}", found=name)
    if len(words) % 2:
        raise InputError("has no value", key=words[-1])
    return {name[2:]: word for name, word in arguments.items()}


def _number(name: str, word: str) -> float:
    with suppress(ValueError):
        if math.isfinite(value := float(word)):
            return value
    raise InputError(key=name, expected="a finite number", found=repr(word))


def write_ros2(path: Path, lidars: Sequence[RigSensor]) -> None:
    """Write a launch file with a publisher for every LiDAR, in `base_link`."""
    root = Element("launch")
    for lidar in lidars:
        mount = mount_in_frame(lidar)
        words = [f"--{name} {getattr(mount, name)!r}" for name in (*PLACE, *ANGLES)]
        words += [f"--frame-id {BASE}", f"--child-frame-id {shlex.quote(lidar.name)}"]
        SubElement(root, "node", pkg="tf2_ros", exec=PUBLISHER, args=" ".join(words))
    write_xml(path, root)
