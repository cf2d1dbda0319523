"""The section of detectors: AP and recall in the paper's layout, and who is sensitive."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from scipy import stats

from lidarplace.base.metrics import RANKING, headline_metric
from tracking.figures.kit.style import colour, figure, legend_below, symbol, text
from tracking.findings.groups import Group
from tracking.kitti_iou import headline_iou, judged, judged_by_all
from tracking.labels import detector_label, metric_label, plus_minus, setting_label
from tracking.pages.section import (
    METRIC,
    PERCENT,
    Column,
    Section,
    Table,
    numbers,
    slug,
    with_units,
    words,
)
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder

MOST_COLUMNS = 12
"""Placements of a table with a column each; more are in the tables of all placements."""


def detectors_section(found: Analysis) -> Section | None:
    """AP and recall with a row a detector and a column a placement; None without results."""
    run, means = found.run, found.means
    if run.results.empty or run.results["placement"].nunique() < 2:
        return None
    section = Section("Detectors", columns=2)
    section.notes.append(
        "AP and recall in percent, means over seeds, in the layout of the paper's tables; the "
        "best of a row is bold. Sensitivity is the spread between the best and the worst "
        "placement. The spread by seeds alone is that of equal placements in one sweep of "
        "twenty: a smaller spread shows no influence of the placement. A relative spread is "
        "over the mean."
    )
    spreads = sensitivity(means, run.axes)
    for name in (*run.classes, "all"):
        own = judged_by_all(spreads, run.results, name)
        section.notes += _most_sensitive(name, own, run.axes)
        plot = sensitivity_figure(own, run.axes, class_label(name))
        section.figures += [] if plot is None else [plot]
        if run.results["placement"].nunique() <= MOST_COLUMNS:
            section.tables += _layout(run, found.groups, means, name)
    section.tables.append(_sensitivity_table(spreads, run))
    return section


def _layout(
    run: RunFolder, found: list[Group], means: pd.DataFrame, object_class: str
) -> list[Table]:
    """A table for every metric of the class at its headline IoU."""
    placements = [name for name in run.placements if name in set(run.results["placement"])]
    tables = []
    for metric in RANKING:
        iou = headline_iou(run.results, object_class, metric)
        cells = judged(means, run.results, object_class, metric)
        rows: list[tuple[str, ...]] = []
        data: list[dict[str, object]] = []
        best = set()
        for group in found:
            own = group.of(cells).set_index("placement").reindex(placements)
            if not own["mean"].notna().any():
                continue
            best.add((len(rows), 1 + int(np.nanargmax(own["mean"].to_numpy()))))
            cell = [plus_minus(*pair) for pair in zip(own["mean"], own["sd"], strict=True)]
            rows.append((group.title, *cell))
            setting = {"detector": group.detector, **group.setting}
            data += [
                {**setting, "placement": placement, **row}
                for placement, row in own[["mean", "sd", "low", "high", "seeds"]].iterrows()
            ]
        if rows:
            name = class_label(object_class)
            label = metric_label(metric, iou)
            tables.append(
                Table(
                    f"{name} · {label} (%)",
                    ("detector", *placements),
                    tuple(rows),
                    frozenset(best),
                    name=slug("layout", object_class, label),
                    data=with_units(pd.DataFrame(data), PERCENT),
                )
            )
    return tables


def _most_sensitive(object_class: str, spreads: pd.DataFrame, axes: Sequence[str]) -> list[str]:
    """Where the placement moves 3D AP, or recall, most, relative to its mean."""
    own = spreads[(spreads["metric"] == headline_metric(object_class))]
    own = own[own["relative"].notna()]
    if own.empty:
        return []
    row = own.sort_values("relative").iloc[-1]
    name = class_label(object_class)
    settings = own[list(axes)].drop_duplicates()
    kinds = "detectors" if len(settings) == 1 else "detectors and settings"
    title = detector_label(axes, row.to_dict())
    who = f" of {title}, the most of {len(own)} {kinds}," if len(own) > 1 else ""
    verdict = (
        "one seed, so it is not known how much of it is chance"
        if np.isnan(row["by_chance"])
        else f"seeds alone make up to {row['by_chance']:.1f}"
    )
    return [
        f"{name}: {metric_label(row['metric'], row['iou'])}{who} varies by "
        f"{row['spread']:.1f} points, {100 * row['relative']:.0f} % of its mean, "
        f"between {row['worst']} and {row['best']} "
        f"({verdict})."
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
    return Table.of(
        "Sensitivity to the placement",
        spreads,
        columns,
        wide=True,
        name="sensitivity",
        units={"mean": "%", "spread": "points", "by_chance": "points"},
    )


def sensitivity_figure(spreads: pd.DataFrame, axes: Sequence[str], title: str) -> go.Figure | None:
    """A row a detector and setting, a point a metric; a tick where seeds alone would reach.

    Args:
        spreads: rows of `tracking.report.sections.detectors.sensitivity` for one class.
        title: a name, not yet plotly's text.

    Returns:
        None if there is nothing to draw.
    """
    if spreads.empty:
        return None
    rows = [
        "<br>".join(text(part) for part in (row["detector"], setting_label(axes, row)) if part)
        for row in spreads.to_dict("records")
    ]
    table = spreads.assign(row=rows)
    order = list(dict.fromkeys(rows))
    metrics = list(dict.fromkeys(zip(table["metric"], table["iou"], strict=True)))
    plot = figure(f"Spread over placements · {text(title)}", height=150 + 34 * len(order))
    for i, (metric, iou) in enumerate(metrics):
        own = table[(table["metric"] == metric) & (table["iou"] == iou)]
        label = metric_label(metric, iou)
        plot.add_scatter(
            x=own["spread"].to_numpy(),
            y=own["row"].tolist(),
            mode="markers",
            marker={"size": 10, "color": colour(i), "symbol": symbol(i)},
            name=label,
            customdata=np.stack([own["best"], own["worst"]], axis=-1),
            hovertemplate="%{y}: %{x:.1f} points, from %{customdata[1]} to %{customdata[0]}"
            f"<extra>{label}</extra>",
        )
        chance = own[own["by_chance"].notna()]
        plot.add_scatter(
            x=chance["by_chance"].to_numpy(),
            y=chance["row"].tolist(),
            mode="markers",
            marker={
                "size": 14,
                "symbol": "line-ns-open",
                "line": {"width": 2, "color": colour(i)},
                "color": colour(i),
            },
            name="by seeds alone",
            legendgroup="chance",
            showlegend=i == 0 and len(chance) > 0,
            hovertemplate=f"%{{y}}: seeds alone make up to %{{x:.1f}} points<extra>{label}</extra>",
        )
    plot.update_xaxes(title="best less worst placement (points)", rangemode="tozero")
    plot.update_yaxes(categoryorder="array", categoryarray=order[::-1])
    legend_below(plot)
    return plot


CHANCE = 0.95
"""Share of sweeps of equal placements whose spread stays below `by_chance`."""


def sensitivity(means: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """The spread between the best and the worst placement.

    Args:
        means: `tracking.findings.summary.seed_means`.

    Returns:
        One row per (class, detector, axes, metric, iou, difficulty) with at least two placements:
        `n` placements, the `best` and the `worst`, the `mean` over placements (percent), `spread`
        (best less worst, points), `relative` (spread / mean), and `by_chance`: what seeds alone
        would make of placements that are equal, in points, the 95 % quantile of the studentized
        range. NaN with one seed each.
    """
    keys = ["class", "detector", *axes, "metric", "iou", "difficulty"]
    columns = [*keys, "n", "best", "worst", "mean", "spread", "relative", "by_chance"]
    rows = []
    known = means[means["seeds"] > 0]
    for key, own in known.groupby(keys, dropna=False, sort=False):
        if len(own) < 2:
            continue
        values = own.set_index("placement")["mean"]
        spread, mean = float(values.max() - values.min()), float(values.mean())
        relative = spread / mean if mean > 0 else np.nan
        best, worst = values.idxmax(), values.idxmin()
        rows.append((*key, len(own), best, worst, mean, spread, relative, _by_chance(own)))
    return pd.DataFrame(rows, columns=columns)


@lru_cache(maxsize=256)
def _quantile(placements: int, freedom: int) -> float:
    return float(stats.studentized_range.ppf(CHANCE, placements, freedom))


def _by_chance(own: pd.DataFrame) -> float:
    freedom = own["seeds"] - 1
    if freedom.sum() < 1:
        return np.nan
    pooled = float(np.sqrt((freedom * own["sd"].fillna(0) ** 2).sum() / freedom.sum()))
    # Unequal numbers of seeds: Kramer's harmonic mean.
    seeds = stats.hmean(own["seeds"])
    return float(_quantile(len(own), int(freedom.sum())) * pooled / np.sqrt(seeds))
