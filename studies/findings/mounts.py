"""What generalists say of exact mounts, of real ones, and of rigs that differ in one thing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from judged import SHORT, label, number, table
from predicting import GENERALIST, every_predictor, of, read
from properties import properties
from scipy import stats

from lidarplace import PAPER_PLACEMENTS
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
COLUMNS = {"car": "Car AP over IoU", "recall": "recall of all"}
_ANGLES = {0.0: "exact", 0.5: "off by 0.5°"}


def pairs_table() -> str:
    """Each rig less `base`, in points with 95 % for all pairs at once; `base` itself first."""
    found = {
        f"{head}, {words}": _controlled(angle, target)
        for angle, words in _ANGLES.items()
        for target, head in COLUMNS.items()
    }
    differences = [one.differences("base") for one in found.values()]
    base = [number(mean(one, "base"), 1) for one in found.values()]
    rows = [[words, *(_shown(d.loc[name]) for d in differences)] for name, words in PAIRS.items()]
    return table(["", *found], [["*base*: four LiDARs, rings interleaved", *base], *rows])


def pair(name: str, target: str, angle: float) -> str:
    """A rig of PAIRS less `base`, with its interval."""
    return _shown(_controlled(angle, target).differences("base").loc[name])


def exact_table(names: Sequence[str] = tuple(PAPER_PLACEMENTS)) -> str:
    """What the generalists give to rigs that are mounted exactly, and to real ones."""
    overlap = properties()["redundancy"]
    both = {target: _both(target) for target in COLUMNS}
    order = both["car"].loc[list(names)].sort_values("exact", ascending=False).index
    rows = []
    for name in order:
        cells = [str(name), f"{overlap[name]:.0%}".replace("%", " %")]
        for own in both.values():
            exact, real = own.loc[name, "exact"], own.loc[name, "real"]
            cells += [number(exact, 1), number(real, 1), number(real - exact, 1, sign=True)]
        rows.append(cells)
    heads = [f"{head}, {kind}" for head in COLUMNS.values() for kind in ("exact", "real", "change")]
    return table(["", "rings that coincide", *heads], rows)


def survives(target: str) -> str:
    """Spearman's rho of exact and real mounts, over all rigs."""
    own = _both(target)
    return number(stats.spearmanr(own["exact"], own["real"]).statistic)


def gained_by_overlap(target: str) -> str:
    """Spearman's rho of what a real mount gains with the share of rings that coincide."""
    own = _both(target)
    gain = own["real"] - own["exact"]
    return number(stats.spearmanr(gain, properties()["redundancy"].loc[gain.index]).statistic)


def seen_table() -> str:
    """How each predictor goes with what generalists say of exact and of real mounts."""
    rows: dict[str, list[str]] = {}
    for target in COLUMNS:
        own, wide = _both(target), every_predictor(SHORT[target])
        for name in wide.columns.drop(GENERALIST):
            cells = rows.setdefault(str(name), [label(str(name))])
            cells += [
                number(stats.spearmanr(wide[name].loc[own.index], own[kind]).statistic)
                for kind in ("exact", "real")
            ]
    heads = [f"{head}, {kind}" for head in COLUMNS.values() for kind in ("exact", "real")]
    return table(["", *heads], [row + ["–"] * (len(heads) + 1 - len(row)) for row in rows.values()])


def mean(found: BestPlacement, name: str) -> float:
    """Of one rig, over seeds."""
    return float(found.means[found.sure.index.get_loc(name)])


def _both(target: str) -> pd.DataFrame:
    """Means over generalists of exact and of real mounts, by rig."""
    real = read("main_results").query("judge == 'generalist'")
    tables = {"exact": read("exact_results"), "real": real}
    return pd.DataFrame(
        {
            kind: of(rows, SHORT[target]).groupby("placement")["value"].mean()
            for kind, rows in tables.items()
        }
    )


def _controlled(angle: float, target: str) -> BestPlacement:
    results, left_out = (
        of(rows[np.isclose(rows["mounting_errors.angle_deg"], angle)], SHORT[target])
        for rows in (read("controlled_results"), read("controlled_left_out"))
    )
    found = best_placement(results, left_out=left_out, generalist=True)
    if found is None:
        raise ValueError(f"no rig of controlled.yaml was judged at {angle} degrees")
    return found


def _shown(row: pd.Series) -> str:
    low, high = number(row["low"], 1, sign=True), number(row["high"], 1, sign=True)
    return f"{number(row['difference'], 1, sign=True)} ({low} to {high})"
