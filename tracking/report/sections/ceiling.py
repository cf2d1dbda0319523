"""Ceiling of a perfect surrogate, and reliability of each metric, by what is noise."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.metrics import METRICS
from tracking.findings.groups import has_detectors
from tracking.findings.paired import group_columns
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.kitti_iou import at_headline_iou, at_headline_ious
from tracking.labels import digits, signed
from tracking.pages.section import Column, Section, Table, numbers, of_group
from tracking.report.analysis import Analysis
from tracking.statistics.reliability import reliability_of_mean


def _ceiling(row: Mapping[Any, Any]) -> str:
    low, high = row["ceiling_low"], row["ceiling_high"]
    value = digits(row["ceiling"], ".2f")
    return f"{value} [{digits(low, '.2f')}, {digits(high, '.2f')}]" if np.isfinite(low) else value


CEILING = Column("ceiling", _ceiling)


def ceilings_table(analysis: Analysis) -> list[Table]:
    """Show the ceiling of every headline metric; [] where there is none."""
    run, ceilings = analysis.run, analysis.ceilings
    if ceilings.empty:
        return []
    headlines = [at_headline_iou(ceilings, run.results, name) for name in (*run.classes, "all")]

    def halves(row: Mapping[Any, Any]) -> str:
        value = digits(row["agreement_of_halves"], ".2f")
        is_known = np.isfinite(row["agreement_of_halves"])
        return f"{value} ({row['unit']}s left out)" if is_known else value

    columns = [
        *of_group(run.axes),
        numbers("placements", "n", ",.0f"),
        numbers("seeds", "seeds", ".3g"),
        numbers("two seeds agree", "agreement_of_seeds", ".2f"),
        numbers("ceiling by seeds", "ceiling_by_seeds", ".2f"),
        Column("two halves of the test objects agree", halves),
        numbers("by test objects", "ceiling_by_objects", ".2f"),
        CEILING,
        numbers("ρ of two detectors", "agreement_of_detectors", ".2f"),
        numbers("ceiling by detectors", "ceiling_by_detectors", ".2f"),
    ]
    caption = "Highest ρ to expect of a surrogate, by source of noise"
    return [Table.of(caption, pd.concat(headlines), columns, name="ceilings", data=ceilings)]


_NOTE = (
    "Halves of the test routes are evaluated apart, in up to five splits: Spearman's ρ of the "
    "placements between two halves, the mean over splits, and the expected value between all these "
    "test frames and as many others, by Spearman and Brown's formula. A reliable metric needs "
    "fewer frames to separate placements; reliability does not mean that the metric matters."
)


def reliability_section(analysis: Analysis) -> Section | None:
    """Rate every metric of a class; None where no halves of the routes can be compared."""
    run = analysis.run
    if run.left_out is None or run.left_out.empty or not has_detectors(run):
        return None
    rated = agreement_of_halves(run.left_out, run.axes)
    if rated.empty:
        return None
    # Detector by detector, the metrics of each in the order of display.
    place = {name: number for number, name in enumerate(METRICS)}
    ordered = rated.sort_values("metric", key=lambda of: of.map(place), kind="stable")
    ordered = ordered.sort_values(["detector", *run.axes], kind="stable")
    names = (*run.classes, "all")
    rows = pd.concat([at_headline_ious(ordered, run.results, name) for name in names])
    columns = [
        *of_group(run.axes),
        numbers("placements", "n", ",.0f"),
        numbers("splits", "splits", ""),
        numbers("ρ of two halves", "agreement", signed),
        numbers("reliability of all test frames", "reliability", ".2f"),
    ]
    table = Table.of(
        "How reliably metrics separate placements", rows, columns, name="reliability", data=rated
    )
    return Section("Which metric separates placements?", [_NOTE], tables=[table])


def agreement_of_halves(left_out: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """Correlate placements between halves of the test routes, for every metric of `left_out`.

    One row per (class, detector, axes, metric, iou) with three placements or more: `n` placements;
    `splits` of the routes; `agreement`, Spearman's rho between the halves, the mean over splits, of
    means over seeds; and `reliability`, what Spearman and Brown's formula makes of it for all
    routes, 0 where halves contradict each other."""
    keys = [key for key in group_columns(axes) if key != "difficulty"]
    halves = left_out[left_out["unit"] == "half"]
    rows = []
    for key, part in halves.groupby(keys, dropna=False, sort=False, observed=True):
        means = part.groupby(["left_out", "placement"])["value"].mean().unstack("left_out").dropna()
        splits = sorted({str(name)[:-1] for name in means})
        if len(means) < 3:
            continue
        rho = [rank_agreement(means[f"{one}a"], means[f"{one}b"])[0] for one in splits]
        agreement = float(np.mean(rho))
        reliable = float(reliability_of_mean(max(agreement, 0.0), 2)) if rho else np.nan
        if not np.isnan(agreement):
            rows.append((*key, len(means), len(splits), agreement, reliable))
    return pd.DataFrame(rows, columns=[*keys, "n", "splits", "agreement", "reliability"])
