"""Rigs that differ in one thing, by generalists."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from predicting import by_generalist, read
from rig_results import SHORT, head_of, led, number, table

from tracking.findings.best_placement import BestPlacement

PAIRS: Mapping[str, str] = {
    "level": "level: all pitches zero",
    "stacked": "level, at four heights",
    "close": "a quarter of the distances from each other",
    "height_2.1": "lower",
    "height_2.7": "higher",
    "height_3.0": "twice as much higher",
    "pitched_+3": "all noses down",
    "pitched_-3": "all noses up",
    "rolled_+10": "sides rolled up",
    "rolled_-10": "sides rolled down",
    "roof_front": "just above the roof, at its front edge",
    "roof_rear": "just above the roof, at its rear edge",
    "one": "one LiDAR",
    "two": "two LiDARs",
    "three": "three LiDARs",
    "six": "six LiDARs",
    "eight": "eight LiDARs",
    "one_of_64": "one LiDAR of as many beams as all",
    "two_of_32": "two LiDARs of as many beams as all",
}
"""Rigs of `controlled.yaml` and what they have other than `base`."""
TARGETS = ("car", "recall")
EXACT, REAL = 0.0, 0.5
"""Degrees by which mounts may be off."""


def controlled_table() -> str:
    """Each rig less `base`, in points with 95 % for all pairs at once; `base` itself first."""
    heads, columns = [""], []
    for target in TARGETS:
        for angle, kind in ((EXACT, "exact"), (REAL, "real")):
            heads.append(f"{head_of(target)}, {kind}")
            columns.append((target, angle))
    rows = [["*base*", *(number(value("base", *column), 1) for column in columns)]]
    for name, words in PAIRS.items():
        rows.append([f"`{name}`: {words}", *(pair(name, *column) for column in columns)])
    return table(heads, rows)


def pair(name: str, target: str, angle: float = REAL) -> str:
    """A rig less `base`, with its interval."""
    return led(_judged(target, angle).differences("base").loc[name])


def lost(name: str, target: str) -> str:
    """What a rig has less than `base` with real mounts, points."""
    found = _judged(target, REAL).differences("base").loc[name]
    return number(-float(found["difference"]), 1)


def value(name: str, target: str, angle: float = REAL) -> float:
    """What the generalist gives a rig, percent."""
    found = _judged(target, angle)
    return float(found.means[found.sure.index.get_loc(name)])


def distance_table() -> str:
    """Car AP over IoU of *base* by distance, and what rigs whose rings coincide have less."""
    rings = read("controlled_distance")
    heads, columns = [""], []
    for angle, kind in ((EXACT, "exact"), (REAL, "real")):
        own = rings[np.isclose(rings["mounting_errors.angle_deg"], angle)]
        wide = own.pivot_table(index=["from_m", "to_m"], columns="placement", values="value")
        columns += [wide["base"], wide["stacked"] - wide["base"], wide["level"] - wide["base"]]
        heads += [f"*base*, {kind}", f"`stacked` less it, {kind}", f"`level` less it, {kind}"]
    rows = []
    for ring in columns[0].index:
        cells = [
            number(float(column.loc[ring]), 1, sign=place % 3 > 0)
            for place, column in enumerate(columns)
        ]
        rows.append([f"{ring[0]:g} to {ring[1]:g} m", *cells])
    return table(heads, rows)


@cache
def _judged(target: str, angle: float) -> BestPlacement:
    return by_generalist(
        "controlled",
        SHORT[target],
        lambda rows: rows[np.isclose(rows["mounting_errors.angle_deg"], angle)],
    )
