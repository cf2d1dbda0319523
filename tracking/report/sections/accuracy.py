"""The section of surrogates that were computed faster: error against run time."""

from __future__ import annotations

import pandas as pd

from tracking.figures.of_sweeps.accuracy import accuracy_figure
from tracking.findings.groups import by_setting, studied
from tracking.findings.surrogate_accuracy import relative_errors, summarise
from tracking.numbers import digits, signed
from tracking.pages.section import Section
from tracking.pages.tables import SURROGATE, Column, Table, numbers, slug
from tracking.run_folders.sweep import RunFolder


def accuracy_section(run: RunFolder) -> Section:
    """Errors and ranks of every cheaper way to compute a surrogate, against its seconds."""
    section = Section("Surrogates: error against run time", columns=1, folded=True)
    if run.accuracy is None or run.accuracy.empty:
        section.notes.append("The run folder has no accuracy.parquet.")
        return section
    section.notes.append(
        "Left: error of the method, of fewer azimuth steps and of fewer frames at one resolution. "
        "Middle: error against the finest resolution that was computed; a coarse grid makes beams "
        "thick and too few rays leave gaps, and the two errors can cancel. Right: whether the "
        "placements are ranked alike, which is what a choice needs. Medians over placements, bars "
        "to the largest; hollow points have no error. The menu chooses the surrogate."
    )
    section.notes += studied(run, run.accuracy)
    for title, part in by_setting(run.accuracy, run.axes):
        summary = summarise(relative_errors(part))
        for name, own in summary.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.figures.append(accuracy_figure(own, f"Error against run time · {label}"))
            section.tables.append(accuracy_table(own, label))
    return section


def accuracy_table(summary: pd.DataFrame, title: str) -> Table:
    """`tracking.findings.surrogate_accuracy.summarise` of one class as text."""
    columns = [
        SURROGATE,
        Column(
            "method",
            lambda row: str(row["method"]) + (" (reference)" if row["reference"] else ""),
            words=True,
        ),
        numbers("resolution (m)", "resolution", "g"),
        Column(
            "azimuth steps",
            lambda row: f"{row['azimuth_steps']:,}" if row["azimuth_steps"] else "all",
        ),
        numbers("frames", "frames", ","),
        numbers("error (%)", "median_error", _percent),
        numbers("worst (%)", "worst_error", _percent),
        numbers("same resolution (%)", "median_method_error", _percent),
        numbers("Spearman ρ", "spearman", signed),
        numbers("Kendall τ", "kendall", signed),
        numbers("seconds", "seconds", ".3g"),
        numbers("POG seconds", "pog_seconds", ".3g"),
    ]
    return Table.of(
        f"Rank agreement with the reference and errors · {title}",
        summary,
        columns,
        wide=True,
        name=slug("surrogate accuracy", title),
        units={"resolution": "m", "seconds": "s", "pog_seconds": "s"},
    )


def _percent(error: float) -> str:
    return digits(100 * error, ".3g")
