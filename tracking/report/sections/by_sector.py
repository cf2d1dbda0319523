"""The section of objects by their direction: how well they are found."""

from __future__ import annotations

import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.by_bin import Bins, by_bin
from tracking.findings.groups import Group
from tracking.labels import metric_label
from tracking.pages.section import Section
from tracking.pages.tables import slug
from tracking.report.sections.binned import binned_table, means_by_bin
from tracking.run_folders.sweep import RunFolder

_METRIC = headline_metric("all")
SECTOR = ["sector", "from_deg", "to_deg"]
"""Columns that tell sectors apart."""


def by_sector_section(run: RunFolder, found: list[Group]) -> Section | None:
    """Recall by sector around the vehicle; None where it was not measured."""
    if run.sector is None or run.sector.empty:
        return None
    section = Section("Objects by their direction", columns=2)
    section.notes.append(
        "Test frames, sectors of 45 degrees around the vehicle; an object is in that of its "
        "centre. Recall: means over seeds with 95 % intervals, which do not contain the chance of "
        "which objects are in a sector."
    )
    for label, rows in means_by_bin(run, found, run.sector, SECTOR, _METRIC):
        own, sectors = in_sectors(rows)
        metric = f"{metric_label(_METRIC, own['iou'].iloc[0])} (%)"
        drawn = own.rename(columns={"mean": "value", "ground_truths": "objects"})
        heading = f"Recall by direction · {text(label)}"
        section.figures.append(by_bin(drawn, sectors, heading, metric, list(run.placements)))
        caption = f"{metric} by direction · {label}"
        name = slug("recall by direction", label)
        section.tables.append(binned_table(own, sectors, caption, name))
    return section


def in_sectors(table: pd.DataFrame) -> tuple[pd.DataFrame, Bins]:
    """The table with the sector of every row as `bin`, and all sectors from the left on."""
    named = table.assign(bin=table["sector"])
    from_the_left = named.sort_values("from_deg", ascending=False)["bin"].unique()
    return named, Bins("direction of the object", tuple(from_the_left))
