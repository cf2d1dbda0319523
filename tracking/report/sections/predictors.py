"""Surrogates as predictors: which predicts AP and recall, how well, and what trusting it costs."""

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd

from tracking import labels
from tracking.findings.groups import has_detectors
from tracking.pages.section import SURROGATE, Column, Section, Table, numbers, of_group
from tracking.report.analysis import Analysis
from tracking.report.sections.ceiling import CEILING, ceilings_table
from tracking.report.sections.correlation import (
    MOST_COEFFICIENTS,
    correlation_table,
    is_headline,
    scatters,
)
from tracking.report.sections.regret import regret_table
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.power import power_table, smallest_detectable

MOST_SENTENCES = 8  # findings that are listed one by one; the table has all of them
_HOW_TO_READ = (
    "A point is a placement, its bar a 95 % interval of the mean over seeds for comparing it with "
    "the others. ρ is Spearman's, with its interval over placements and seeds and its two-sided "
    "permutation p-value; r is Pearson's, τ Kendall's. The range is that of ρ without one "
    "placement in turn. No sign is assumed. The ceiling is the ρ that a surrogate without any "
    "error is expected to reach, as AP and recall are noisy measurements, by the training and by "
    "the objects in the test frames.",
    "Left-out error: each placement predicted by a straight line through the others, and by their "
    "mean. Surrogates with the same or the reverse order of another one are the same test and not "
    "in the first table. Regret: points lost by choosing the placement that a surrogate ranks "
    "first, below the highest mean, which is partly the luckiest, and below the truly best "
    "placement, over what seeds and test objects leave open, with 95 %. A useful surrogate loses "
    "less than a random placement.",
)


def predictors_section(analysis: Analysis) -> Section | None:
    """Show findings, figures by group and class, and tables; None for a sweep without detectors."""
    run, correlations = analysis.run, analysis.correlations
    if not has_detectors(run):
        return None
    section = Section("Can a surrogate be trusted?")
    if not analysis.predictors:
        section.notes.append("Fewer than 3 placements with a metric: no coefficient.")
        return section
    cases = [one for one in analysis.predictors if is_headline(run, one.group)]
    labelled = ((_group_label(run, one.group), one.sentence) for one in cases)
    sentences = [" · ".join(filter(None, pair)) for pair in labelled]
    section.notes += sentences[:MOST_SENTENCES]
    if len(sentences) > MOST_SENTENCES:
        more = f"The first {MOST_SENTENCES} of {len(sentences)} cases; the table has all."
        section.notes.append(more)
    tested = int(correlations["pairs_tested"].iloc[0])
    section.notes.append(
        f"{tested} pairs of a surrogate and a metric were tested: about {0.05 * tested:.0f} "
        "would have p < 0.05 by chance alone if none were related."
    )
    section.notes += [*_power_sentences(correlations), *_HOW_TO_READ]
    if run.promotions is not None and len(run.promotions):
        section.notes.append(
            "Only placements that were promoted were trained in full. A surrogate that chose them "
            "varies less among them than among all: its coefficient here is not that over all."
        )
    section.figures = list(islice(scatters(analysis), 1, None))  # the first screen has the first
    section.tables = [
        _ranking_table(analysis),
        *regret_table(analysis),
        *ceilings_table(analysis),
        _power_table(correlations),
        correlation_table(correlations, run.axes).first(MOST_COEFFICIENTS),
    ]
    return section


def _group_label(run: RunFolder, group: Mapping[Any, Any]) -> str:
    """Name detector and setting, as far as the sweep has several of them."""
    keys = [key for key in ("detector", *run.axes) if key in run.results]
    varying = [key for key in keys if run.results[key].nunique(dropna=False) > 1]
    axes = [axis for axis in varying if axis != "detector"]
    return (labels.detector_label if "detector" in varying else labels.setting_label)(axes, group)


def _power_sentences(correlations: pd.DataFrame) -> Iterator[str]:
    """Say what correlation can be found, one sentence for every number of placements."""
    with_values = correlations[correlations["spearman"].notna()]
    for n, part in with_values.groupby("n"):
        least = smallest_detectable(int(str(n)), "spearman", _reliability(part))
        detectable = "no correlation, however strong, would be found"
        if np.isfinite(least):
            detectable = f"only a |ρ| above {least:.2f} in the population would be found"
        yield (
            f"With {n} placements {detectable} with a probability of 80 % (two-sided test at 5 %, "
            "before any correction for many tests)."
        )


def _reliability(part: pd.DataFrame) -> float:
    """Take the median reliability of a mean over seeds, over tests; 1 where one seed hides it."""
    reliabilities = part["reliability"].dropna()
    return float(reliabilities.median()) if len(reliabilities) else 1.0


def _power_table(correlations: pd.DataFrame) -> Table:
    with_values = correlations[correlations["spearman"].notna()]
    reliability = _reliability(with_values)
    table = power_table(sorted({*with_values["n"], 6, 8, 12, 20, 50}), reliability)

    def least(value: float) -> str:
        return "none" if np.isnan(value) else f"{value:.2f}"

    columns = [
        numbers("placements", "n", ",.0f"),
        numbers("Pearson |r|", "pearson", least),
        numbers("Spearman |ρ|", "spearman", least),
    ]
    caption = (
        "Smallest correlation that a test finds with a probability of 80 %, metrics as reliable as "
        f"here ({reliability:.2f})"
    )
    return Table.of(caption, table, columns, name="power")


def _ranking_table(analysis: Analysis) -> Table:
    run, predicted = analysis.run, analysis.predictors
    keys = [*predicted[0].group, "surrogate"]
    ranges = analysis.errors[[*keys, "spearman_min", "spearman_max"]]
    most = analysis.correlations[[*keys, "ceiling", "ceiling_low", "ceiling_high"]]
    group: list[dict[str, Any]] = [one.group for one in predicted]
    rankings = [one.ranking.rename_axis("surrogate").reset_index() for one in predicted]
    table = pd.concat([ranking.assign(**of) for ranking, of in zip(rankings, group, strict=True)])
    table = table.merge(ranges, how="left", on=keys).merge(most, how="left", on=keys)
    headline = np.repeat([is_headline(run, one.group) for one in predicted], [*map(len, rankings)])

    def behind(row: Mapping[Any, Any]) -> str:
        low, high = row["behind_low"], row["behind_high"]
        if np.isnan(low):
            return labels.DASH
        return (
            f"{row['behind']:.2f} {labels.interval(low, high)}{labels.not_significant(low, high)}"
        )

    columns = [
        *of_group(run.axes),
        SURROGATE,
        numbers("ρ", "spearman", labels.signed),
        CEILING,
        numbers("p", "p", ".2g"),
        numbers("p, Holm", "holm", ".2g"),
        Column(
            "ρ, one left out", lambda r: labels.span(r["spearman_min"], r["spearman_max"], "+z.2f")
        ),
        Column("|ρ| behind the first", behind),
        numbers("left-out error (points)", "rmse", ".2f"),
        numbers("of the mean (points)", "rmse_of_mean", ".2f"),
    ]
    return Table.of(
        "Surrogates of each class, the strongest first",
        table[headline & (table["same_as"] == "")],
        columns,
        wide=True,
        name="predictors",
        data=table,
        units=dict.fromkeys(("rmse", "rmse_of_mean"), "points"),
    )
