"""Sensitivity: how much the placement moves AP and recall of each detector."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pandas as pd
from scipy import stats

from lidarplace.base.metrics import headline_metric
from tracking.kitti_iou import at_headline_ious
from tracking.labels import detector_label, metric_label
from tracking.pages.section import METRIC, Column, Section, Table, numbers, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder


def sensitivity_section(analysis: Analysis) -> Section | None:
    """Show the spread over placements of each metric; None for fewer than two with results."""
    run, means = analysis.run, analysis.means
    if run.results.empty or run.results["placement"].nunique() < 2:
        return None
    note = (
        "Sensitivity is the spread between the best and the worst placement. The spread by seeds "
        "alone is that of equal placements in one sweep of twenty: a smaller spread shows no "
        "influence of the placement. A relative spread is over the mean."
    )
    section = Section("Does the placement matter?", [note])
    spreads = sensitivity(means, run.axes)
    for name in (*run.classes, "all"):
        of_class = at_headline_ious(spreads, run.results, name)
        section.notes += _most_sensitive(name, of_class, run.axes)
    section.tables.append(_sensitivity_table(spreads, run))
    return section


def _most_sensitive(object_class: str, spreads: pd.DataFrame, axes: Sequence[str]) -> list[str]:
    """Say where the placement moves 3D AP, or recall, most, relative to its mean."""
    rows = spreads[spreads["metric"] == headline_metric(object_class)].dropna(subset="relative")
    if rows.empty:
        return []
    row = rows.sort_values("relative").iloc[-1]
    kinds = (
        "detectors" if len(rows[list(axes)].drop_duplicates()) == 1 else "detectors and settings"
    )
    title = detector_label(axes, row.to_dict())
    where = f" of {title}, the most of {len(rows)} {kinds}," if len(rows) > 1 else ""
    verdict = f"seeds alone make up to {row['by_chance']:.1f}"
    if np.isnan(row["by_chance"]):
        verdict = "one seed, so it is not known how much of it is chance"
    return [
        f"{class_label(object_class)}: {metric_label(row['metric'], row['iou'])}{where} "
        f"varies by {row['spread']:.1f} points, {100 * row['relative']:.0f} % of its mean, "
        f"between {row['worst']} and {row['best']} ({verdict})."
    ]


def _sensitivity_table(spreads: pd.DataFrame, run: RunFolder) -> Table:
    columns = [
        words("class"),
        words("detector"),
        *(words(axis.rsplit(".", 1)[-1], axis) for axis in run.axes),
        METRIC,
        numbers("n", "n", ""),
        words("best"),
        words("worst"),
        numbers("mean (%)", "mean", ".1f"),
        numbers("spread (points)", "spread", ".1f"),
        numbers("by seeds alone (points)", "by_chance", ".1f"),
        Column(
            "spread / mean",
            lambda row: "–" if np.isnan(row["relative"]) else f"{100 * row['relative']:.0f} %",
        ),
    ]
    units = {"mean": "%", "spread": "points", "by_chance": "points"}
    caption = "Sensitivity to the placement"
    return Table.of(caption, spreads, columns, units, wide=True, name="sensitivity")


CHANCE = 0.95  # share of sweeps of equal placements whose spread stays below `by_chance`
_quantile = cache(stats.studentized_range.ppf)  # which takes long


def sensitivity(means: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """Compute the spread between the best and the worst placement, of `seed_means`.

    One row per (class, detector, axes, metric, iou, difficulty) with at least two placements:
    `mean` over them (percent), `spread` (points), `relative` (spread / mean), and `by_chance`: what
    seeds alone would make of equal placements, points, the 95 % quantile of the studentized range;
    NaN with one seed each."""
    keys = ["class", "detector", *axes, "metric", "iou", "difficulty"]
    columns = [*keys, "n", "best", "worst", "mean", "spread", "relative", "by_chance"]
    rows = []
    tested = means[means["seeds"] > 0]
    for key, part in tested.groupby(keys, dropna=False, sort=False):
        if len(part) < 2:
            continue
        values = part.set_index("placement")["mean"]
        spread, mean = float(values.max() - values.min()), float(values.mean())
        relative = spread / mean if mean > 0 else np.nan
        best, worst = values.idxmax(), values.idxmin()
        rows.append((*key, len(part), best, worst, mean, spread, relative, _by_chance(part)))
    return pd.DataFrame(rows, columns=columns)


def _by_chance(means: pd.DataFrame) -> float:
    freedom = means["seeds"] - 1
    if freedom.sum() < 1:
        return np.nan
    pooled = float(np.sqrt((freedom * means["sd"].fillna(0) ** 2).sum() / freedom.sum()))
    # Unequal numbers of seeds: Kramer's harmonic mean.
    seeds = stats.hmean(means["seeds"])
    return float(_quantile(CHANCE, len(means), int(freedom.sum())) * pooled / np.sqrt(seeds))
