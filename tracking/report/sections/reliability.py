"""The section of how reliably each metric tells placements apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.metrics import METRICS, headline_metric
from tracking.findings.groups import has_detectors
from tracking.kitti_iou import judged_by_all
from tracking.labels import metric_label, setting_label
from tracking.numbers import digits
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, Column, Table, numbers, words
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.reliability import reliability_of_mean

_NOTE = (
    "Reliability is the share of a metric's variance between placements that is not noise: 1 where "
    "other test frames would show the same differences. How well two halves of the test objects "
    "agree follows from leaving out each route, or each individual, and from it, by Spearman and "
    "Brown's formula, the reliability by all of them. A reliable metric needs fewer frames to tell "
    "placements apart; whether what it measures matters it does not say."
)


def reliability_section(run: RunFolder, ceilings: pd.DataFrame) -> Section | None:
    """A row for every metric of a class; None where nothing was left out of the test frames.

    Args:
        ceilings: `tracking.findings.ceiling.ceilings` of the run.
    """
    if not has_detectors(run) or not ceilings["agreement_of_halves"].notna().any():
        return None
    halves = ceilings["agreement_of_halves"].to_numpy(np.float64)
    rated = ceilings.assign(reliability=reliability_of_mean(halves, 2))
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
        numbers("two seeds agree", "agreement_of_seeds", ".2f"),
        numbers("two halves of the test objects agree", "agreement_of_halves", ".2f"),
        numbers("reliability by all test objects", "reliability", ".2f"),
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
