"""Left-hand traffic by its mirror image: y turns into -y, and who kept left keeps right.

netconvert has an option for left-hand traffic, but with OpenDRIVE it exchanges the sides of every
road instead of the direction of its lanes. So it is given the mirrored map, and what is recorded in
there is mirrored back.
"""

from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog

_POLYNOMIAL = ("a", "b", "c", "d")

_CHANGES_SIGN = {
    "offset": ("y", "hdg"),
    "geometry": ("y", "hdg"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": _POLYNOMIAL,
    "paramPoly3": ("aV", "bV", "cV", "dV"),
    "superelevation": _POLYNOMIAL,
    "laneOffset": _POLYNOMIAL,
    "lane": ("id",),
    "laneLink": ("from", "to"),
    "validity": ("fromLane", "toLane"),
    "signal": ("t", "hOffset"),
    "signalReference": ("t",),
    "object": ("t", "hdg"),
    "repeat": ("tStart", "tEnd"),
}
"""Attributes, by element, that are measured to the left, or turn to it, or number lanes."""


def mirror_map(root: Element) -> None:
    """Mirror an OpenDRIVE tree without namespaces in place: left lanes become right ones."""
    for element in root.iter():
        for name in _CHANGES_SIGN.get(element.tag, ()):
            _negate(element, name)
    for link in root.iterfind(".//lane/link/*"):
        _negate(link, "id")
    for section in root.iter("laneSection"):
        section[:] = reversed(section)  # sides and lanes are listed from left to right
        for side in section:
            side.tag = {"left": "right", "right": "left"}.get(side.tag, side.tag)
            side[:] = reversed(side)


def _negate(element: Element, name: str) -> None:
    """Change the sign of a number as it is written, so that no digit is lost."""
    if text := element.get(name, "").strip():
        element.set(name, text[1:] if text[0] == "-" else f"-{text.removeprefix('+')}")


def mirror_log(log: BoxLog) -> BoxLog:
    """The mirror image of a log: objects, poses and buildings."""
    return replace(
        log,
        boxes=log.boxes.assign(y=-log.boxes["y"], yaw=_turned(log.boxes["yaw"])),
        frames=log.frames.assign(
            ego_y=-log.frames["ego_y"], ego_yaw=_turned(log.frames["ego_yaw"])
        ),
        buildings=log.buildings.assign(y=-log.buildings["y"], yaw=_turned(log.buildings["yaw"])),
    )


def _turned(yaw: pd.Series) -> NDArray[np.float64]:
    """Minus the angles, which are in (-pi, pi] and stay there."""
    return np.where(yaw == np.pi, np.pi, -yaw)
