"""Rigs as links of a URDF, held by fixed joints (https://wiki.ros.org/urdf/XML)."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.xml import read_xml, write_xml
from lidarplace.rig_files.mounted import (
    BASE,
    Joint,
    MountedLidar,
    lidars_of,
    mount_at,
    mount_in_frame,
)


def read_urdf(path: Path, only: Sequence[str]) -> list[MountedLidar]:
    """The links that are LiDARs, as `lidars_of` knows them. `rpy` are roll, pitch and yaw about
    fixed axes, which is `Rz(yaw) Ry(pitch) Rx(roll)`. Raises ValueError: the file is no URDF, is
    xacro, or its frames are none of a vehicle."""
    root = read_xml(path)
    if root.tag != "robot":
        raise InputError(f"not a URDF: its root is {root.tag}, not robot", place=path)
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise InputError("contains xacro", place=path, fix="run xacro, and pass its output")
    joints = [_joint(element, path) for element in root.iterfind("joint")]
    return lidars_of(joints, only, str(path))


def _joint(element: Element, path: Path) -> Joint:
    where = f"{path}: joint {element.get('name')}"
    parent, child = (_link(element, name, where) for name in ("parent", "child"))
    kind = element.get("type", "none")
    position, rpy = (_vector(element.find("origin"), key, where) for key in ("xyz", "rpy"))
    moves = "" if kind == "fixed" else f"{kind}, not fixed"
    return Joint(parent, child, position, mount_at(position, rpy, where).rotation, moves)


def _link(joint: Element, name: str, where: str) -> str:
    for found in joint.iterfind(f"{name}[@link]"):
        return found.attrib["link"]
    raise InputError(f"no {name} with a link", place=where)


def _vector(origin: Element | None, key: str, where: str) -> NDArray[np.float64]:
    """Three numbers of an origin, which are 0 if it is left out."""
    text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
    with suppress(ValueError):
        values = np.array([float(word) for word in text.split()])
        if values.shape == (3,) and np.isfinite(values).all():
            return values
    raise InputError(f"{key} must be 3 finite numbers", place=where, found=repr(text))


def write_urdf(path: Path, lidars: Sequence[MountedLidar]) -> None:
    """Write a link `base_link`, and one with a fixed joint for every LiDAR."""
    root = Element("robot", name=path.stem)
    SubElement(root, "link", name=BASE)
    for lidar in lidars:
        SubElement(root, "link", name=lidar.name)
        joint = SubElement(root, "joint", name=f"{BASE}_to_{lidar.name}", type="fixed")
        SubElement(joint, "parent", link=BASE)
        SubElement(joint, "child", link=lidar.name)
        numbers = [repr(number) for number in astuple(mount_in_frame(lidar))]
        SubElement(joint, "origin", xyz=" ".join(numbers[:3]), rpy=" ".join(numbers[3:]))
    write_xml(path, root)
