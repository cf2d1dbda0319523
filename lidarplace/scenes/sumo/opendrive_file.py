"""OpenDRIVE files, and what is said of those that netconvert would misread or misname."""

import gzip
import zlib
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

from lidarplace.files.regular import regular

RULES = ("RHT", "LHT")
"""Right-hand and left-hand traffic; the first is meant where a road has no rule."""


def read_opendrive(path: Path) -> Element:
    """The tree of `path` (`.xodr` or `.xodr.gz`), without namespaces.

    Centre lanes without a type get "none": they have no width, and OpenDRIVE 1.8 has them so.

    Raises:
        ValueError: no OpenDRIVE, a lane without id or type, or a direct junction.
    """
    try:
        data = regular(path).read_bytes()
        data = gzip.decompress(data) if path.suffix == ".gz" else data
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ValueError(f"{path}: not a gzip file: {error}") from None
    try:
        root = fromstring(data)
    except (ParseError, LookupError, ValueError) as error:
        raise ValueError(f"{path}: not an OpenDRIVE map: {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "OpenDRIVE":
        raise ValueError(f"{path}: not an OpenDRIVE map: its root is {root.tag}, not OpenDRIVE")
    for junction in root.iter("junction"):
        if junction.get("type") == "direct":
            raise ValueError(
                f"{path}: junction {junction.get('id')} is of type direct, which netconvert cannot "
                "read; allowed are junctions with connecting roads, or links from road to road"
            )
    for lane in root.iterfind(".//center/lane"):
        lane.set("type", lane.get("type", "none"))
    for road in root.iter("road"):
        for lane in road.iter("lane"):
            for name in ("id", "type"):
                if name not in lane.attrib:
                    which = f"lane {lane.get('id')}" if name == "type" else "a lane"
                    raise ValueError(f"{path}: road {road.get('id')}: {which} has no {name}")
    return root


def drives_left(root: Element, path: Path) -> bool:
    """Whether the map of `root`, read from `path`, has left-hand traffic.

    Raises:
        ValueError: the rule of a road is neither of `RULES`, or the rules of two roads differ.
    """
    first: dict[str, str | None] = {}
    for road in root.iter("road"):
        rule = road.get("rule", RULES[0])
        if rule not in RULES:
            raise ValueError(
                f"{path}: road {road.get('id')}: rule is {rule!r}; allowed are "
                f"{' and '.join(RULES)}"
            )
        first.setdefault(rule, road.get("id"))
    if len(first) > 1:
        raise ValueError(
            f"{path}: road {first['LHT']} has left-hand traffic (rule LHT), road {first['RHT']} "
            "right-hand traffic (rule RHT, or none); allowed is one of them in a map"
        )
    return "LHT" in first
