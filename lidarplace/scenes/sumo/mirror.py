"""Left-hand traffic by its mirror image: y turns into -y, and who kept left keeps right.

netconvert's own option exchanges the sides of OpenDRIVE's roads, not the direction of their lanes.
So it is given the mirrored map, and what is recorded in there is mirrored back."""

from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np
import pandas as pd

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
    """Mirror the objects, poses and buildings of a log."""
    boxes, buildings = (_mirrored(table, "y", "yaw") for table in (log.boxes, log.buildings))
    frames = _mirrored(log.frames, "ego_y", "ego_yaw")
    return replace(log, boxes=boxes, frames=frames, buildings=buildings)


def _mirrored(table: pd.DataFrame, y: str, yaw: str) -> pd.DataFrame:
    """Mirror the columns `y` and `yaw`; angles stay in (-pi, pi]."""
    turned = (-table[yaw]).where(table[yaw] != np.pi, np.pi)
    return table.assign(**{y: -table[y], yaw: turned})
