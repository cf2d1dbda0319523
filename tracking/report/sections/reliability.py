"""The section of how reliably each metric tells placements apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from lidarplace.base.metrics import METRICS, headline_metric
from tracking.findings.groups import has_detectors
from tracking.findings.halves import agreement_of_halves
from tracking.kitti_iou import judged_by_all
from tracking.labels import metric_label, setting_label
from tracking.numbers import digits, signed
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, Column, Table, numbers, words
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder

_NOTE = (
    "Halves of the test routes are evaluated apart, in up to five splits: Spearman's ρ of the "
    "placements between two halves, the mean over splits, and what it would be between all these "
    "test frames and as many others, by Spearman and Brown's formula. A reliable metric needs "
    "fewer frames to tell placements apart; whether what it measures matters it does not say."
)


def reliability_section(run: RunFolder) -> Section | None:
    """A row for every metric of a class; None where no halves of the routes can be compared."""
    if run.left_out is None or run.left_out.empty or not has_detectors(run):
        return None
    rated = agreement_of_halves(run.left_out, run.axes)
    if rated.empty:
        return None
    rows = [judged_by_all(rated, run.results, name) for name in (*run.classes, "all")]
    shown = pd.concat([_in_order(own, run.axes) for own in rows])

    def detector(row: Mapping[Any, Any]) -> str:
        axes = setting_label(run.axes, [row[axis] for axis in run.axes])
        return ", ".join(part for part in (str(row["detector"]), axes) if part)

    columns = [
        words("class"),
        Column("detector", detector, words=True),
        METRIC,
        numbers("placements", "n", ",.0f"),
        numbers("splits", "splits", ""),
        numbers("ρ of two halves", "agreement", signed),
        numbers("reliability of all test frames", "reliability", ".2f"),
    ]
    table = Table.of(
        "How reliably metrics tell placements apart", shown, columns, name="reliability", data=rated
    )
    notes = [_NOTE, *_most_reliable(shown)]
    return Section("Which metric tells placements apart?", notes, tables=[table])


def _in_order(rows: pd.DataFrame, axes: tuple[str, ...]) -> pd.DataFrame:
    """Rows of a class, detector by detector, the metrics of each in the order of display."""
    place = {name: number for number, name in enumerate(METRICS)}
    ordered = rows.sort_values("metric", key=lambda of: of.map(place), kind="stable")
    return ordered.sort_values(["detector", *axes], kind="stable")


def _most_reliable(shown: pd.DataFrame) -> Iterator[str]:
    """Of every class the most reliable metric, and how reliable the headline's is."""
    keys = ["class", "metric", "iou"]
    means = shown.groupby(keys, sort=False)["reliability"].mean().dropna().reset_index()
    for name, own in means.groupby("class", sort=False):
        first, *others = own.sort_values("reliability", ascending=False).to_dict("records")
        told = f"{class_label(str(name))}: {_label(first)} is most reliable, {_rated(first)}"
        headline = [row for row in others if row["metric"] == headline_metric(str(name))]
        told += "".join(f"; {_label(row)} has {_rated(row)}" for row in headline)
        yield f"{told}."


def _label(row: Mapping[Any, Any]) -> str:
    return metric_label(row["metric"], row["iou"])


def _rated(row: Mapping[Any, Any]) -> str:
    return digits(row["reliability"], ".2f")
