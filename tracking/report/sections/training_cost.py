"""The section of shorter trainings: AP against seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.training_cost import training_cost_figure
from tracking.findings.groups import by_setting
from tracking.findings.training_cost import (
    COST_AXES,
    summarise_cost,
    training_cost,
    varied_cost_axes,
)
from tracking.numbers import plus_minus, signed
from tracking.pages.section import Section
from tracking.pages.tables import Column, Table, numbers, slug
from tracking.run_folders.sweep import RunFolder


def training_cost_section(run: RunFolder) -> Section | None:
    """AP of shorter trainings and the ranks they give; None if all are as long."""
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
