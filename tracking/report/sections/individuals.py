"""The section of the objects behind the numbers: boxes, individuals, routes."""

import pandas as pd

from tracking.findings.groups import by_setting, has_detectors
from tracking.findings.individuals import MOST_FREQUENT, count_individuals
from tracking.pages.section import Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis


def individuals_section(found: Analysis) -> Section | None:
    """How many individuals were met; None for a sweep without detectors."""
    run = found.run
    if not has_detectors(run):
        return None
    section = Section("Objects: boxes and individuals")
    if run.individuals is None or run.individuals.empty:
        section.notes.append("The run folder has no individuals.parquet.")
        return section
    section.notes.append(
        "A box is an object in one frame; a road user that is in 50 frames is one individual, and "
        "one of two routes too. Frames of one individual say nearly the same, so what was "
        "measured is as sure as its individuals and routes are many, not its boxes. A log that "
        "does not name its objects has as many individuals as boxes."
    )
    for title, part in by_setting(run.individuals, run.axes):
        section.tables.append(individuals_table(part, title))
    return section


def individuals_table(individuals: pd.DataFrame, title: str) -> Table:
    """`count_individuals` as text."""
    counts = count_individuals(individuals)
    columns = [
        Column("frames", lambda row: _SPLITS.get(row["split"], str(row["split"])), words=True),
        words("class"),
        numbers("routes with any", "routes", ","),
        numbers("boxes", "boxes", ","),
        numbers("individuals", "individuals", ","),
        Column(
            f"boxes of the {MOST_FREQUENT} most frequent",
            lambda row: f"{100 * row['share_of_ten']:.0f} %",
        ),
    ]
    return Table.of(
        "Objects that count" + (f" · {title}" if title else ""),
        counts,
        columns,
        name=slug("individuals", title),
    )


_SPLITS = {"train": "training"}
