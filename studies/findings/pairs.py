"""Rigs that differ from one rig in one thing: what a generalist says of the difference."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pandas as pd
from judged import HEADS, SHORT, number, table
from predicting import of, read

from tracking.findings.best_placement import BestPlacement, best_placement

PAIRS: Mapping[str, str] = {
    "level": "level: all pitches 0",
    "stacked": "level, at heights of 2.1 to 2.7 m",
    "close": "a quarter of the distances from each other",
    "height_2.1": "30 cm lower",
    "height_2.7": "30 cm higher",
    "height_3.0": "60 cm higher",
    "pitched_+3": "pitch of all + 3°",
    "pitched_-3": "pitch of all − 3°",
    "rolled_+10": "roll of the left ones + 10°, of the right ones − 10°",
    "rolled_-10": "roll of the left ones − 10°, of the right ones + 10°",
    "roof_front": "10 cm above the roof, at its front edge",
    "roof_rear": "10 cm above the roof, at its rear edge",
    "one": "one LiDAR",
    "two": "two LiDARs",
    "three": "three LiDARs",
    "six": "six LiDARs",
    "eight": "eight LiDARs",
    "one_of_64": "one LiDAR of 64 beams",
    "two_of_32": "two LiDARs of 32 beams",
}
"""Rigs of `controlled.yaml` and what they have other than `base`."""
TARGETS = ("car", "recall")
_ANGLES = {0.0: "exact", 0.5: "off by 0.5°"}


def pairs_table() -> str:
    """Each rig less `base`, in points with 95 % for all pairs at once; `base` itself first."""
    found = {
        f"{HEADS[list(SHORT).index(target)]}, {words}": controlled(angle, target)
        for target in TARGETS
        for angle, words in _ANGLES.items()
    }
    differences = [one.differences("base") for one in found.values()]
    base = [number(_mean(one, "base"), 1) for one in found.values()]
    rows = [[words, *(_shown(d.loc[name]) for d in differences)] for name, words in PAIRS.items()]
    return table(["", *found], [["*base*: four LiDARs, rings interleaved", *base], *rows])


def pair(name: str, target: str, angle: float) -> str:
    """A rig of PAIRS less `base`, with its interval."""
    return _shown(controlled(angle, target).differences("base").loc[name])


@cache
def controlled(angle: float, target: str) -> BestPlacement:
    """The rigs of `controlled.yaml` with mounts off by `angle` degrees, against each other."""
    results, left_out = (
        of(rows[np.isclose(rows["mounting_errors.angle_deg"], angle)], SHORT[target])
        for rows in (read("controlled_results"), read("controlled_left_out"))
    )
    found = best_placement(results, left_out=left_out, generalist=True)
    if found is None:
        raise ValueError(f"no rig of controlled.yaml was judged at {angle} degrees")
    return found


def _mean(found: BestPlacement, name: str) -> float:
    return float(found.means[found.sure.index.get_loc(name)])


def _shown(row: pd.Series) -> str:
    low, high = number(row["low"], 1, sign=True), number(row["high"], 1, sign=True)
    return f"{number(row['difference'], 1, sign=True)} ({low} to {high})"
