"""Surrogates against AP and recall, over placements: figures and all coefficients."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import headline_metric
from tracking import labels
from tracking.figures.kit.named_points import add_placements, label_places
from tracking.figures.kit.style import add_menu, broken, figure, text
from tracking.findings.paired import group_columns
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import at_headline_iou, headline_iou
from tracking.pages.section import METRIC, SURROGATE, Table, coefficient, numbers, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.ceiling import CEILING
from tracking.run_folders.sweep import RunFolder

MOST_COEFFICIENTS = 300  # rows of the table of all coefficients that the page shows


def scatters(analysis: Analysis) -> Iterator[go.Figure]:
    """Draw a point for each placement, in a figure for every group and class."""
    run = analysis.run
    keys = [*group_columns(run.axes), "surrogate"]
    left_out = analysis.errors[[*keys, "spearman_min", "spearman_max"]]
    tested = analysis.correlations.merge(left_out, on=keys, how="left")
    summed = analysis.summed_surrogates
    for group in analysis.groups:
        for name in (*run.classes, "all"):
            parts = (group.of(analysis.means), group.of(tested))
            of_class, tests = (at_headline_iou(part, run.results, name) for part in parts)
            if (tests["n"] > 0).any():
                title = text(group.label(class_label(name)))
                predictors = surrogates_of(summed, group.place, name)
                yield scatter(of_class, predictors, tests, title, list(run.placements))


def is_headline(run: RunFolder, group: Mapping[str, object]) -> bool:
    """Tell whether a group is about 3D AP of a class, or recall of all, at the headline IoU."""
    name = str(group["class"])
    headline = (headline_metric(name), headline_iou(run.results, name))
    return (group["metric"], group["iou"]) == headline


def correlation_table(correlations: pd.DataFrame, axes: Sequence[str]) -> Table:
    """Show every coefficient with interval and p-value."""
    columns = [
        words("class"),
        words("detector"),
        *(words(axis.rsplit(".", 1)[-1], axis) for axis in axes),
        METRIC,
        SURROGATE,
        numbers("n", "n", ""),
        numbers("seeds", "seeds", ""),
        coefficient("Pearson r", "pearson"),
        numbers("p", "pearson_p", ".2g"),
        coefficient("Spearman ρ", "spearman"),
        *([CEILING] if "ceiling" in correlations.columns else []),
        numbers("p", "spearman_p", ".2g"),
        numbers("p, Holm", "spearman_holm", ".2g"),
        coefficient("Kendall τ", "kendall"),
        numbers("p", "kendall_p", ".2g"),
        words("note"),
    ]
    caption = "All coefficients, 95 % intervals in brackets"
    return Table.of(caption, correlations, columns, wide=True, name="coefficients")


def scatter(
    metric: pd.DataFrame,
    surrogates: pd.DataFrame,
    correlations: pd.DataFrame,
    title: str,
    placements: Sequence[str],
) -> go.Figure:
    """Draw points named by placement with 95 % intervals for a comparison; a menu of surrogates.

    `metric` are rows of `seed_means` of one group, `surrogates` those of `surrogates_of`,
    `correlations` those of `correlate`."""
    coefficients = {row["surrogate"]: row for row in correlations.to_dict("records")}
    menu = [name for name in labels.in_order(coefficients) if coefficients[name]["n"] > 0]
    table = metric[metric["seeds"] > 0].set_index("placement").join(surrogates, how="inner")
    table = table.loc[[name for name in placements if name in table.index]]
    names = [str(name) for name in table.index]
    label = labels.metric_label(*metric.iloc[0][["metric", "iou"]])

    small = '<span style="font-size:12px">'
    heads = [f"{title}<br>{small}{_coefficient(coefficients[name])}</span>" for name in menu]
    mean, half = (table[key].to_numpy(np.float64) for key in ("mean", "half"))
    plot = figure(heads[0], height=400, margin={"t": 120})
    hover = "%{text}<br>%{x:.6g}<br>%{y:.2f} %<extra></extra>"
    values = table[menu[0]]
    add_placements(plot, values, mean, half, names, placements, hovertemplate=hover)
    plot.update_xaxes(title=labels.surrogate_label(menu[0]))
    plot.update_yaxes(title=f"{label} (%)")
    changes = []
    for name, head in zip(menu, heads, strict=True):
        layout = {"title.text": broken(head), "xaxis.title.text": labels.surrogate_label(name)}
        places = label_places(table[name].to_numpy(np.float64), mean, names, half)
        data = {"x": [table[name].to_list()], "textposition": [places]}
        changes.append((data, layout | {"xaxis.autorange": True}))
    return add_menu(plot, [labels.surrogate_name(name) for name in menu], changes, y=1.02)


def _coefficient(row: Mapping[Hashable, Any]) -> str:
    if np.isnan(row["spearman"]):
        return text(row["note"])
    rho = f"ρ = {labels.signed(row['spearman'])} "
    rho += labels.interval(row["spearman_low"], row["spearman_high"])
    rho += f", p = {row['spearman_p']:.2g}, n = {row['n']}"
    if np.isfinite(row["ceiling"]):
        rho += f", ceiling {row['ceiling']:.2f}"
    others = f"r = {labels.signed(row['pearson'])}, τ = {labels.signed(row['kendall'])}"
    if np.isnan(row["spearman_min"]):
        return f"{rho}<br>{others}"
    span = f"{labels.signed(row['spearman_min'])} to {labels.signed(row['spearman_max'])}"
    return f"{rho}<br>{others}; one left out: ρ {span}"
