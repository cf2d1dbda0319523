"""The section of roll and pitch: placements that differ in one angle alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd

from lidarplace.base.metrics import RANKING
from lidarplace.rigs.placement import Mount
from tracking.findings.groups import Group
from tracking.kitti_iou import judged
from tracking.pages.section import METRIC, Section, Table, in_points, numbers, words
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder

ANGLES = ("roll", "pitch")
_DIGITS = 6  # a micrometre, a microradian


def tilts_section(found: Analysis) -> Section | None:
    """What tilting LiDARs did to AP and recall; None without such a pair."""
    run = found.run
    pairs = [pair for pair in tilt_pairs(run.placements) if not run.results.empty]
    differences = _differences(run, found.groups, found.means, pairs)
    if differences.empty:
        return None
    section = Section("Ablation: roll and pitch")
    section.notes.append(
        "Pairs of placements that differ in the roll, or in the pitch, of some LiDARs and in "
        "nothing else. Differences are tilted less upright, with 95 % intervals; each pair "
        "separately, without a correction for their number."
    )
    if differences["low"].isna().any():
        section.notes.append("A pair with one seed each has no interval.")
    section.tables.append(_table(differences))
    return section


def _differences(
    run: RunFolder, found: list[Group], means: pd.DataFrame, pairs: list[TiltPair]
) -> pd.DataFrame:
    """A row for every pair, group, class and metric that both placements have."""
    rows = []
    for name in (*run.classes, "all"):
        for metric in RANKING:
            for group in found:
                own = judged(group.of(means), run.results, name, metric)
                own = own[own["seeds"] > 0].set_index("placement")
                for pair in pairs:
                    if {pair.upright, pair.tilted} <= {*own.index}:
                        rows.append(
                            {
                                "angle": pair.angle,
                                "pair": f"{pair.upright} → {pair.tilted}",
                                "class": name,
                                "detector": group.title,
                                "metric": metric,
                                "iou": own["iou"].iloc[0],
                                **_difference(own, pair),
                            }
                        )
    return pd.DataFrame(rows)


def _difference(means: pd.DataFrame, pair: TiltPair) -> dict[str, float]:
    """Of two means over seeds. Their intervals share one pooled spread, so they add in squares."""
    upright, tilted = means["mean"][pair.upright], means["mean"][pair.tilted]
    difference = tilted - upright
    half = np.hypot(means["half"][pair.upright], means["half"][pair.tilted])
    return {
        "upright": upright,
        "tilted": tilted,
        "difference": difference,
        "low": difference - half,
        "high": difference + half,
    }


def _table(differences: pd.DataFrame) -> Table:
    columns = [
        words("angle"),
        words("pair"),
        words("class"),
        words("detector"),
        METRIC,
        numbers("upright (%)", "upright", ".1f"),
        numbers("tilted (%)", "tilted", ".1f"),
        in_points("difference (points)", ("difference", "low", "high"), "+z.1f"),
    ]
    units = dict.fromkeys(("upright", "tilted"), "%")
    units |= dict.fromkeys(("difference", "low", "high"), "points")
    return Table.of(
        "Tilted less upright, 95 % intervals in brackets",
        differences,
        columns,
        wide=True,
        name="roll-and-pitch",
        units=units,
    )


class TiltPair(NamedTuple):
    """Two placements, equal but for one angle of some LiDARs; `upright` is tilted less, summed over
    LiDARs."""

    angle: str
    upright: str
    tilted: str


def tilt_pairs(placements: Mapping[str, Sequence[Mount]]) -> list[TiltPair]:
    """All pairs of `placements` that differ in one of `ANGLES` alone, in their order.

    The order of the LiDARs does not matter. Pairs in which both are tilted equally much have no
    upright one and are left out.
    """
    found = []
    for angle in ANGLES:
        bases = {name: _without(mounts, angle) for name, mounts in placements.items()}
        tilts = {
            name: round(sum(abs(getattr(mount, angle)) for mount in mounts), _DIGITS)
            for name, mounts in placements.items()
        }
        for a, b in combinations(placements, 2):
            if bases[a] == bases[b] and tilts[a] != tilts[b]:
                upright, tilted = sorted((a, b), key=tilts.__getitem__)
                found.append(TiltPair(angle, upright, tilted))
    return found


def _without(mounts: Sequence[Mount], angle: str) -> list[tuple[float, ...]]:
    level = (astuple(replace(mount, **{angle: 0.0})) for mount in mounts)
    return sorted(tuple(round(value, _DIGITS) + 0.0 for value in mount) for mount in level)
