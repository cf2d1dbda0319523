"""Shorter trainings: AP against seconds."""

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, error_bars, figure, legend_below, symbol, text
from tracking.findings.groups import by_setting
from tracking.findings.training_cost import (
    COST_AXES,
    summarise_cost,
    training_cost,
    varied_cost_axes,
)
from tracking.labels import DASH, plus_minus, setting_label, signed
from tracking.pages.section import Column, Section, Table, numbers, slug
from tracking.report.analysis import Analysis


def training_cost_section(analysis: Analysis) -> Section | None:
    """Show AP of shorter trainings and the ranks they give; None if all are as long."""
    run = analysis.whole
    if not varied_cost_axes(run.results):
        return None
    section = Section("Training: error against run time", columns=2)
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
        for name, of_class in summary.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.figures.append(training_cost_figure(of_class, varied, text(label)))
            section.tables.append(training_cost_table(of_class, varied, label))
    return section


def training_cost_table(summary: pd.DataFrame, axes: Sequence[str], title: str) -> Table:
    """Show `tracking.findings.training_cost.summarise_cost` of one class and setting as text."""
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
        Column(
            "below the longest",
            lambda row: DASH if row["reference"] else plus_minus(row["error"], row["error_sd"]),
        ),
        Column("Kendall τ", lambda row: DASH if row["reference"] else signed(row["kendall"])),
    ]
    caption = f"Means over placements and seeds, rank agreement of the placements · {title}"
    units = {"seconds": "s", "ap": "%", "error": "points"}
    return Table.of(caption, summary, columns, name=slug("training cost", title), units=units)


def training_cost_figure(summary: pd.DataFrame, axes: Sequence[str], title: str) -> go.Figure:
    """Draw AP below the longest training over seconds: a line a detector, bars one sd.

    `summary` is `summarise_cost` of one class and setting, `axes` name the points."""
    plot = figure(title, height=380)
    for i, (detector, of_detector) in enumerate(summary.groupby("detector", sort=False)):
        of_detector = of_detector.sort_values("seconds")
        shapes = ["star" if best else symbol(i) for best in of_detector["reference"]]
        plot.add_scatter(
            x=of_detector["seconds"].to_numpy(),
            y=of_detector["error"].to_numpy(),
            error_y=error_bars(of_detector["error_sd"].fillna(0), thickness=1),
            mode="lines+markers+text",
            line={"color": colour(i), "width": 1.5},
            marker={"size": 10, "symbol": shapes},
            text=[setting_label(axes, row) for row in of_detector.to_dict("records")],
            textposition="top right",
            textfont={"size": 10},
            cliponaxis=False,
            name=text(detector),
            showlegend=True,
            hovertemplate="%{text}<br>%{x:.3g} s: %{y:.2f} points<extra></extra>",
        )
    plot.update_xaxes(type="log", title="seconds of training; the star is the longest")
    plot.update_yaxes(title="AP below the longest (points)")
    return legend_below(plot)
