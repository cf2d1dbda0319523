"""The sections of trainings: learning curves, and AP of shorter ones against seconds."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.figures.kit.style import SYMBOLS, colour, figure, symbol, text
from tracking.findings.groups import by_setting, has_detectors
from tracking.findings.training_cost import (
    COST_AXES,
    summarise_cost,
    training_cost,
    varied_cost_axes,
)
from tracking.labels import metric_label, plus_minus, signed
from tracking.pages.section import Column, Section, Table, numbers, slug
from tracking.report.analysis import Analysis

_EPOCHS, _SHARE = COST_AXES
_PANELS = (("ap", "{} (%)"), ("error", "AP below the longest training"))
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
"""Colours that some eyes take for one come with different ones."""


def training_cost_section(found: Analysis) -> Section | None:
    """AP of shorter trainings and the ranks they give; None if all are as long."""
    run = found.whole
    if not varied_cost_axes(run.results):
        return None
    section = Section("Training: error against run time", columns=1, folded=True)
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append(
        "AP after fewer epochs and with a share of the training frames, against the seconds of all "
        "epochs. The reference is the longest training of the same placement, detector and seed, "
        "and the error is its AP less that of a trial. Kendall's τ says whether a shorter training "
        "ranks the placements as the longest one does. Everything else on this page is about the "
        "longest training."
    )
    cost = training_cost(run.results, run.curves, run.axes)
    varied = varied_cost_axes(run.results)
    further = [axis for axis in run.axes if axis not in COST_AXES]
    for title, part in by_setting(cost, further):
        # Means are over the same placements; promotion trains more of them short than long.
        summary = summarise_cost(part[part["reference_ap"].notna()], varied)
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.figures.append(training_cost_figure(own, text(label), list(run.placements)))
            section.tables.append(
                training_cost_table(summary[summary["class"] == name], varied, label)
            )
    return section


def training_cost_table(summary: pd.DataFrame, axes: Sequence[str], title: str) -> Table:
    """`tracking.findings.training_cost.summarise_cost` of one class and setting as text."""

    def below(row: Mapping[Any, Any]) -> str:
        return "–" if row["reference"] else plus_minus(row["error"], row["error_sd"])

    def tau(row: Mapping[Any, Any]) -> str:
        return "–" if row["reference"] else signed(row["kendall"])

    columns = [
        Column(
            "detector",
            lambda row: str(row["detector"]) + (" (longest)" if row["reference"] else ""),
            words=True,
        ),
        *(numbers(axis.rsplit(".", 1)[-1].replace("_", " "), axis, "g") for axis in axes),
        numbers("trials", "trials", ""),
        numbers("seconds", "seconds", ".3g"),
        numbers("3D AP (%)", "ap", ".1f"),
        Column("below the longest", below),
        Column("Kendall τ", tau),
    ]
    caption = f"Means over placements and seeds, rank agreement of the placements · {title}"
    units = {"seconds": "s", "ap": "%", "error": "points"}
    return Table.of(caption, summary, columns, name=slug("training cost", title), units=units)


def training_cost_figure(cost: pd.DataFrame, title: str, placements: Sequence[str]) -> go.Figure:
    """Left AP, right its error, over seconds of training: a mark a trial.

    A colour and a dash are a placement of a detector, a symbol a share of the frames; lines join
    trainings that differ in their epochs alone. Stars are the longest trainings.

    Args:
        cost: `tracking.findings.training_cost.training_cost` for one class and setting of the other
            axes.
    """
    plot = make_subplots(rows=1, cols=2, horizontal_spacing=0.09, figure=figure(title, height=420))
    cost = cost.assign(**{axis: 1 for axis in COST_AXES if axis not in cost})
    detectors = list(dict.fromkeys(cost["detector"]))
    shares = sorted(cost[_SHARE].unique(), reverse=True)
    named: set[int] = set()
    for (detector, placement, share, _), line in cost.groupby(
        ["detector", "placement", _SHARE, "seed"], sort=False
    ):
        line = line.sort_values(_EPOCHS)
        rank = detectors.index(detector) * len(placements) + placements.index(placement)
        name = text(placement if len(detectors) == 1 else f"{detector} · {placement}")
        shape = SYMBOLS[shares.index(share) % len(SYMBOLS)]
        for column, (value, _) in enumerate(_PANELS, start=1):
            plot.add_scatter(
                x=line["seconds"].to_numpy(),
                y=line[value].to_numpy(),
                mode="lines+markers",
                line={"color": colour(rank), "width": 1.5, "dash": _DASHES[rank % len(_DASHES)]},
                marker={
                    "size": [13 if best else 8 for best in line["reference"]],
                    "symbol": ["star" if best else shape for best in line["reference"]],
                },
                customdata=line[[_EPOCHS, "seed"]].to_numpy(),
                hovertemplate=f"{name}, seed %{{customdata[1]}}<br>%{{customdata[0]}} epochs, "
                f"{share:g} of the frames<br>%{{x:.3g}} s: %{{y:.2f}}<extra></extra>",
                name=name,
                legendgroup=str(rank),
                showlegend=column == 1 and rank not in named,
                row=1,
                col=column,
            )
        named.add(rank)
    for share in shares if len(shares) > 1 else ():
        shape = SYMBOLS[shares.index(share) % len(SYMBOLS)]
        _key(plot, shape, "all frames" if share == 1 else f"{share:g} of the frames")
    _key(plot, "star", "longest training")
    label = metric_label(HEADLINE_METRIC, cost["iou"].iloc[0])
    for column, (_, axis) in enumerate(_PANELS, start=1):
        plot.update_yaxes(title=axis.format(label), col=column)
    plot.update_xaxes(type="log", title="seconds of training")
    plot.update_layout(legend={"orientation": "h", "y": -0.2}, margin={"b": 96})
    return plot


def _key(plot: go.Figure, shape: str, name: str) -> None:
    """An entry of the legend for a symbol."""
    plot.add_scatter(
        x=[None],
        y=[None],
        mode="markers",
        marker={"symbol": shape, "size": 9, "color": "#888888"},
        name=name,
        row=1,
        col=1,
    )


def curves_section(found: Analysis) -> Section | None:
    """A figure a group and metric of training; None for a sweep without detectors."""
    run = found.run
    if not has_detectors(run):
        return None
    section = Section("Learning curves")
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append("One line a trial; lines of one colour differ by seed.")
    for group in found.groups:
        for metric in dict.fromkeys(run.curves["metric"]):
            plot = learning_curves(
                run.curves, group.of(run.trials), metric, text(group.title), list(run.placements)
            )
            section.figures.append(plot)
    section.columns = min(2, len(section.figures))
    return section


def learning_curves(
    curves: pd.DataFrame, trials: pd.DataFrame, metric: str, title: str, placements: Sequence[str]
) -> go.Figure:
    """One line a trial, a colour a placement: lines of one colour differ by seed.

    Args:
        curves: trial, epoch, metric, value.
        trials: the trials to show: trial, placement, seed.
    """
    plot = figure(title, height=400)
    shown: set[str] = set()
    points = curves[curves["metric"] == metric].sort_values("epoch")
    for trial in trials.to_dict("records"):
        line = points[points["trial"] == trial["trial"]]
        if line.empty:
            continue
        name = str(trial["placement"])
        rank = placements.index(name)
        plot.add_scatter(
            x=line["epoch"].to_numpy(),
            y=line["value"].to_numpy(),
            mode="lines+markers",
            line={"color": colour(rank), "width": 1.5},
            marker={"size": 5, "symbol": symbol(rank)},
            name=text(name),
            legendgroup=str(rank),
            showlegend=name not in shown,
            hovertemplate=f"{text(name)}, seed {trial['seed']}<br>"
            "epoch %{x}: %{y:.4g}<extra></extra>",
        )
        shown.add(name)
    plot.update_xaxes(title="epoch", tick0=0, dtick=max(1, round(points["epoch"].max() / 10)))
    plot.update_yaxes(title=text(metric))
    plot.update_layout(legend={"orientation": "h", "y": -0.2})
    return plot
