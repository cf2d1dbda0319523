"""The section of objects by their distance: points on them, and how well they are detected."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.by_bin import Bins, by_bin
from tracking.findings.groups import Group, by_setting, has_detectors
from tracking.labels import metric_label
from tracking.pages.section import Section
from tracking.pages.tables import Table, slug
from tracking.report.sections.binned import binned_table, means_by_bin, wide
from tracking.run_folders.sweep import RunFolder

RING = ["from_m", "to_m"]
"""Columns that tell rings apart."""


def by_distance_section(run: RunFolder, found: list[Group]) -> Section | None:
    """Points per object, then AP, by distance; None for a sweep without detectors."""
    if not has_detectors(run):
        return None
    section = Section("Objects by their distance", columns=2)
    if run.points is None or run.points.empty or run.distance is None:
        section.notes.append("The run folder has no points.parquet and distance.parquet.")
        return section
    section.notes.append(
        "Test frames; distance is from the origin of the ego frame to the centre of the object. "
        "Points: the mean over objects, those without any included. AP: means over seeds with 95 % "
        "intervals, which do not contain the chance of which objects are in a ring; with n below "
        "41 of them even a perfect detector has (n - 1) / 40."
    )
    names = list(run.placements)
    for title, part in by_setting(run.points, run.axes):
        for name, rows in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            own, rings = in_rings(rows)
            drawn = own.assign(value=own["mean"], low=np.nan, high=np.nan)
            heading = f"Points per object · {text(label)}"
            section.figures.append(by_bin(drawn, rings, heading, "points per object", names, True))
            section.tables.append(_points_table(own, rings, label))
    for label, rows in means_by_bin(run, found, run.distance, RING, HEADLINE_METRIC):
        own, rings = in_rings(rows)
        metric = f"{metric_label(HEADLINE_METRIC, own['iou'].iloc[0])} (%)"
        drawn = own.rename(columns={"mean": "value", "ground_truths": "objects"})
        heading = f"AP by distance · {text(label)}"
        section.figures.append(by_bin(drawn, rings, heading, metric, names))
        caption = f"{metric} by distance · {label}"
        section.tables.append(binned_table(own, rings, caption, slug("ap by distance", label)))
    return section


def in_rings(table: pd.DataFrame) -> tuple[pd.DataFrame, Bins]:
    """The table with the ring of every row as `bin`, and all rings from the nearest on."""
    low, high = table["from_m"], table["to_m"]
    labels = [
        f"{a:g}–{b:g}" if np.isfinite(b) else f"{a:g}+" for a, b in zip(low, high, strict=True)
    ]
    named = table.assign(bin=labels)
    order = named.sort_values("from_m")["bin"].unique()
    return named, Bins("distance of the object (m)", tuple(order), " m")


def _points_table(own: pd.DataFrame, rings: Bins, label: str) -> Table:
    means, unseen = wide(own, rings, "mean"), wide(own, rings, "unseen")
    rows = tuple(
        (
            str(name),
            *(
                "–" if np.isnan(mean) else f"{mean:,.1f} ({100 * share:.0f} %)"
                for mean, share in zip(means.loc[name], unseen.loc[name], strict=True)
            ),
        )
        for name in means.index
    )
    data = own.drop(columns="bin")
    return Table(
        f"Points per object, share of the objects without any in brackets · {label}",
        ("placement", *(f"{ring}{rings.unit}" for ring in rings.names)),
        rows,
        name=slug("points per object", label),
        data=data.rename(columns={"mean": "points_mean", "median": "points_median"}),
    )
