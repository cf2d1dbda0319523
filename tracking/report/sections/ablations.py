"""Ablations: traffic density, and placements that differ in one angle alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pandas as pd

from lidarplace.base.metrics import RANKING
from lidarplace.rigs.placement import Mount
from tracking.kitti_iou import at_headline_iou
from tracking.labels import plus_minus, points
from tracking.pages.section import (
    METRIC,
    MOST_ROWS,
    PERCENT,
    Section,
    Table,
    in_points,
    numbers,
    slug,
    with_units,
    words,
)
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label, headline_label
from tracking.report.sections.published import DIGITS, published_density_table, rounded

DENSITY = "scene.density"


def density_section(analysis: Analysis) -> Section | None:
    """Compare traffic densities, a column each; None for a sweep with fewer than two."""
    run = analysis.run
    if DENSITY not in run.axes or run.trials[DENSITY].nunique() < 2:
        return None
    densities = sorted(run.trials[DENSITY].dropna().unique().tolist())
    note = (
        "The same placements in sparser and denser traffic. Each density has its own scenes for "
        "training and testing."
    )
    section = Section("Ablation: density", [note])
    # One density each: the groups of the others differ in density alone.
    alike = [
        g for g in analysis.groups if g.setting[DENSITY] == analysis.groups[0].setting[DENSITY]
    ]
    for name in (*run.classes, "all"):
        label = headline_label(run.results, name)
        means = at_headline_iou(analysis.means, run.results, name)
        for group in alike:
            same = group.setting
            parts = [replace(group, setting={**same, DENSITY: d}).of(means) for d in densities]
            title = f"{class_label(name)} · {label} (%)"
            if len(alike) > 1:
                setting = {axis: v for axis, v in group.setting.items() if axis != DENSITY}
                title = f"{title} · {replace(group, setting=setting).title}"
            if any(part["seeds"].gt(0).any() for part in parts):
                section.tables.append(_metric_table(pd.concat(parts), densities, title))
    section.notes.append(
        "The paper published this ablation for one placement, Square, without the number of "
        "vehicles in its dense, medium and sparse traffic."
    )
    section.tables.append(published_density_table())
    return section


def _metric_table(means: pd.DataFrame, densities: list[object], caption: str) -> Table:
    wide = [means[means[DENSITY] == density].set_index("placement") for density in densities]
    rows = []
    for name in means["placement"].unique():
        cells = [table.reindex([name]).iloc[0] for table in wide]
        change = cells[-1]["mean"] - cells[0]["mean"]
        rows.append((name, *(plus_minus(c["mean"], c["sd"]) for c in cells), points(change)))
    head = ("placement", *(f"density {density}" for density in densities), "change (points)")
    columns = ["placement", "detector", DENSITY, "mean", "sd", "low", "high", "seeds"]
    return Table(
        caption,
        head,
        tuple(rows),
        name=slug("density", caption),
        data=with_units(means[columns], PERCENT),
    ).first(MOST_ROWS)


ANGLES = ("roll", "pitch")
_DIFFERENCE = ("difference", "low", "high")


def tilts_section(analysis: Analysis) -> Section | None:
    """Compare placements with more and less tilted LiDARs; None without such a pair."""
    differences = tilt_differences(analysis)
    if differences.empty:
        return None
    note = (
        "Pairs of placements that differ in the roll, or in the pitch, of some LiDARs and in "
        "nothing else. Differences are tilted less upright, with 95 % intervals; each pair "
        "separately, without a correction for their number."
    )
    section = Section("Ablation: roll and pitch", [note])
    if differences["low"].isna().any():
        section.notes.append("A pair with one seed each has no interval.")
    columns = [
        *(words(name) for name in ("angle", "pair", "class", "detector")),
        METRIC,
        numbers("upright (%)", "upright", ".1f"),
        numbers("tilted (%)", "tilted", ".1f"),
        in_points("difference (points)", _DIFFERENCE, "+z.1f"),
    ]
    units = dict.fromkeys(("upright", "tilted"), "%") | dict.fromkeys(_DIFFERENCE, "points")
    caption = "Tilted less upright, 95 % intervals in brackets"
    further = {"wide": True, "name": "roll-and-pitch"}
    section.tables.append(Table.of(caption, differences, columns, units, **further))
    return section


def tilt_differences(analysis: Analysis) -> pd.DataFrame:
    """Compare each of `tilt_pairs` in every group, class and metric that both have; a row each."""
    run, groups, means, rows = analysis.run, analysis.groups, analysis.means, []
    pairs = [] if run.results.empty else tilt_pairs(run.placements)
    names = (*run.classes, "all")
    for name, metric, group in product(names, RANKING, groups):
        of_metric = at_headline_iou(group.of(means), run.results, name, metric)
        of_metric = of_metric[of_metric["seeds"] > 0].set_index("placement")
        for pair in pairs:
            if {pair.upright, pair.tilted} <= {*of_metric.index}:
                both = of_metric.loc[[pair.upright, pair.tilted]]
                upright, tilted = both["mean"]
                # Both intervals share one pooled spread, so they add in squares.
                difference, half = tilted - upright, np.hypot(*both["half"])
                bounds = (difference, difference - half, difference + half)
                of = (pair.angle, f"{pair.upright} → {pair.tilted}", name, group.title, metric)
                rows.append((*of, of_metric["iou"].iloc[0], upright, tilted, *bounds))
    columns = ["angle", "pair", "class", "detector", "metric", "iou", "upright", "tilted"]
    return pd.DataFrame(rows, columns=[*columns, *_DIFFERENCE])


class TiltPair(NamedTuple):
    """Two placements, equal but for one angle of some LiDARs.

    `upright` is tilted less, summed over LiDARs."""

    angle: str
    upright: str
    tilted: str


def tilt_pairs(placements: Mapping[str, Sequence[Mount]]) -> list[TiltPair]:
    """List the pairs of `placements` that differ in one of `ANGLES` alone, in their order.

    The order of the LiDARs does not matter. Pairs in which both are tilted equally are left out."""
    pairs = []
    for angle in ANGLES:
        bases = {
            name: rounded([replace(mount, **{angle: 0.0}) for mount in mounts])
            for name, mounts in placements.items()
        }
        tilts = {
            name: round(sum(abs(getattr(mount, angle)) for mount in mounts), DIGITS)
            for name, mounts in placements.items()
        }
        for a, b in combinations(placements, 2):
            if bases[a] == bases[b] and tilts[a] != tilts[b]:
                upright, tilted = sorted((a, b), key=tilts.__getitem__)
                pairs.append(TiltPair(angle, upright, tilted))
    return pairs
