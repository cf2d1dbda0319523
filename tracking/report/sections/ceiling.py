"""The section of what a perfect surrogate could reach."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking.findings.groups import has_detectors
from tracking.kitti_iou import headline_iou
from tracking.labels import detector_label
from tracking.numbers import digits, span
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, Column, Table, numbers, words
from tracking.report.analysis import Analysis

CEILING_IN_A_LINE = (
    "The ceiling is the ρ that a surrogate without any error is expected to reach, as AP and "
    "recall are themselves measured with noise: of the training, and of which objects the test "
    "frames met."
)
_NOTES = (
    "Noise of a metric lowers its correlation with whatever predicts it: to the root of the "
    "metric's reliability at best, the share of its variance between placements that is not noise "
    "(Spearman 1904). By seeds: from the agreement of two seeds, for the mean of those that there "
    "are. By test objects: from leaving out each route, or each individual, paired over "
    "placements; two halves of the test frames agree by what stands beside it. Ceiling: by both, "
    "with a 95 % interval. By luck a surrogate of few placements may be above it.",
    "By detectors: if a surrogate knows only what the detectors agree in, it correlates with each "
    "by the root of their mean ρ.",
)
_UNKNOWN = (
    "No ceiling is known: placements do not differ, or neither seeds nor test objects tell the "
    "noise."
)


def _ceiling(row: Mapping[Any, Any]) -> str:
    low, high = row["ceiling_low"], row["ceiling_high"]
    shown = digits(row["ceiling"], ".2f")
    return f"{shown} [{digits(low, '.2f')}, {digits(high, '.2f')}]" if np.isfinite(low) else shown


CEILING = Column("ceiling", _ceiling)


def ceiling_section(found: Analysis) -> Section | None:
    """A table with a row for every headline metric; None for a sweep without detectors."""
    run, ceilings = found.run, found.ceilings
    if not has_detectors(run) or ceilings.empty:
        return None
    of_headline = {
        name: (headline_metric(name), headline_iou(run.results, name))
        for name in (*run.classes, "all")
    }
    shown = [
        of_headline.get(name) == (metric, iou)
        for name, metric, iou in zip(
            ceilings["class"], ceilings["metric"], ceilings["iou"], strict=True
        )
    ]

    def halves(row: Mapping[Any, Any]) -> str:
        shown = digits(row["agreement_of_halves"], ".2f")
        known = np.isfinite(row["agreement_of_halves"])
        return f"{shown} ({row['unit']}s left out)" if known else shown

    columns = [
        words("class"),
        Column("detector", partial(detector_label, run.axes), words=True),
        METRIC,
        numbers("placements", "n", ",.0f"),
        numbers("seeds", "seeds", ".3g"),
        numbers("two seeds agree", "agreement_of_seeds", ".2f"),
        numbers("ceiling by seeds", "ceiling_by_seeds", ".2f"),
        Column("two halves of the test objects agree", halves),
        numbers("by test objects", "ceiling_by_objects", ".2f"),
        CEILING,
    ]
    several = ceilings["agreement_of_detectors"].notna().any()
    if several:
        columns += [
            numbers("ρ of two detectors", "agreement_of_detectors", ".2f"),
            numbers("ceiling by detectors", "ceiling_by_detectors", ".2f"),
        ]
    table = Table.of(
        "The highest ρ that is to be expected of a surrogate",
        ceilings[shown],
        columns,
        name="ceilings",
        data=ceilings,
    )
    return Section(
        "What could a perfect surrogate reach?",
        [*(_NOTES if several else _NOTES[:1]), *_span(ceilings[shown])],
        tables=[table],
    )


def _span(shown: pd.DataFrame) -> list[str]:
    """The range over the headline metrics."""
    known = shown["ceiling"].dropna()
    if known.empty:
        return [_UNKNOWN]
    return [f"Here it is {span(known.min(), known.max(), '.2f')} over what headlines tell."]
