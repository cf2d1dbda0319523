"""Does anything that the released code does otherwise turn the rigs' order to that in print?"""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from predicting import by_generalist, by_own, of, read
from rig_results import led, number, table

from tracking.findings.best_placement import BestPlacement
from tracking.published import published_detection

PAIRS = (
    ("center", "line"),
    ("center", "pyramid"),
    ("center", "trapezoid"),
    ("line_roll", "line"),
    ("pyramid_roll", "pyramid"),
    ("pyramid_pitch", "pyramid"),
)
"""Of which the paper prints both; each time the second one is the better one there."""
CAR_3D = ("Car", "AP_R40_3D", 0.7)
CAR_BEV = ("Car", "AP_R40_BEV", 0.7)
AXES = ("lidar.cloud_share", "lidar.tilt_in_degrees", "scene.split")
_SPARSE = 0.1
"""Share of a cloud below which it is the released code's."""


def riddle_table() -> str:
    """AP of the first of each pair less that of the second: in print, and for each combination."""
    rows = [["*in print*, mean over its detectors", *_printed()]]
    for combination in combinations():
        rows.append([words(combination), *_differences(_judged(combination, CAR_3D))])
    anchors = by_generalist("anchors", CAR_3D)
    own = by_own("released", CAR_3D)
    rows.append(["the paper's text and anchors", *_differences(anchors)])
    rows.append(["all of the released code, own detectors", *_differences(own)])
    return table(["", *(f"{one} − {other}" for one, other in PAIRS)], rows)


def center_wins(target: tuple[str, str, float] = CAR_3D) -> int:
    """In how many combinations *center* is the best of the eight."""
    return sum(_judged(one, target).best == "center" for one in combinations())


def widest() -> float:
    """Half of the widest interval of a difference, points: what the experiment cannot see."""
    halves = []
    for combination in combinations():
        for one, other in PAIRS:
            row = _judged(combination, CAR_3D).differences(other).loc[one]
            halves.append((row["high"] - row["low"]) / 2)
    return float(max(halves))


def combinations() -> list[tuple[object, ...]]:
    """Values of AXES that were tried, as the paper's text has them first."""
    found = read("riddle_results")[list(AXES)].drop_duplicates()
    order = found.sort_values(list(AXES), ascending=[False, True, False])
    return [tuple(row) for row in order.itertuples(index=False)]


def words(combination: tuple[object, ...]) -> str:
    """What a combination has of the released code."""
    share, tilt, split = combination
    said = [
        *(["4,000 rays a LiDAR"] if float(str(share)) < _SPARSE else []),
        *(["tilts in degrees"] if tilt else []),
        *(["every tenth frame as test"] if split == "paper" else []),
    ]
    return ", ".join(said) or "the paper's text"


def _differences(found: BestPlacement) -> list[str]:
    return [led(found.differences(other).loc[one]) for one, other in PAIRS]


def _printed() -> list[str]:
    """Differences of the paper's tables; each over the detectors that have both."""
    rows = of(published_detection(), CAR_3D)
    wide = rows[rows["density"] == ""].pivot_table(
        index="detector", columns="placement", values="value", aggfunc="first"
    )
    return [number(float((wide[one] - wide[other]).mean()), 1, sign=True) for one, other in PAIRS]


@cache
def _judged(combination: tuple[object, ...], target: tuple[str, str, float]) -> BestPlacement:
    return by_generalist("riddle", target, lambda rows: _with(rows, combination))


def _with(rows: pd.DataFrame, combination: tuple[object, ...]) -> pd.DataFrame:
    share, *others = combination
    same = np.isclose(rows[AXES[0]], float(str(share)))
    for axis, value in zip(AXES[1:], others, strict=True):
        same &= (rows[axis] == value).to_numpy()
    return rows[same]
