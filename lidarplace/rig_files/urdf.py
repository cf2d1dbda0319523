"""Rigs as links of a URDF, held by fixed joints (https://wiki.ros.org/urdf/XML)."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.files.xml import read_xml, write_xml
from lidarplace.rig_files.mounted import BASE, Joint, RigSensor, lidars_of, mount_in_frame
from lidarplace.rigs.placement import Mount


def read_urdf(path: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the links that are LiDARs, see `lidars_of`.

    `rpy` are roll, pitch and yaw about fixed axes, which is `Rz(yaw) Ry(pitch) Rx(roll)`. Raises
    ValueError: the file is not URDF, is xacro, or has no frame of a vehicle."""
    root = read_xml(path)
    with at(path):
        if root.tag != "robot":
            raise InputError("not a URDF", expected="the root robot", found=root.tag)
        if any("xacro" in str(element.tag) for element in root.iter()):
            raise InputError(
                "contains xacro", fix=f"run `xacro {path.name} > car.urdf`, and pass that"
            )
        return lidars_of([_joint(element) for element in root.iterfind("joint")], only)


def _joint(element: Element) -> Joint:
    kind = element.get("type", "none")
    moves = "" if kind == "fixed" else f"{kind}, not fixed"
    with at(f"joint {element.get('name')}"):
        parent, child = (_link(element, name) for name in ("parent", "child"))
        position, rpy = (_vector(element.find("origin"), key) for key in ("xyz", "rpy"))
        return Joint(parent, child, position, Mount(*position, *rpy).rotation, moves)


def _link(joint: Element, name: str) -> str:
    for element in joint.iterfind(f"{name}[@link]"):
        return element.attrib["link"]
    raise InputError(f"no {name} with a link")


def _vector(origin: Element | None, key: str) -> NDArray[np.float64]:
    """Return three numbers of an origin, which are 0 if it is left out."""
    text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
    with suppress(ValueError):
        values = np.array([float(word) for word in text.split()])
        if values.shape == (3,) and np.isfinite(values).all():
            return values
    raise InputError(key=key, expected="3 finite numbers", found=repr(text))


def write_urdf(path: Path, lidars: Sequence[RigSensor]) -> None:
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
