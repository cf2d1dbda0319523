"""The section of surrogates against AP and recall, over placements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.scatter import scatter
from tracking.findings.groups import Group, has_detectors
from tracking.findings.paired import group_columns, with_sums
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import judged
from tracking.numbers import interval, signed
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, SURROGATE, Column, Table, numbers, words
from tracking.report.headline import class_label
from tracking.report.sections.ceiling import CEILING, CEILING_IN_A_LINE
from tracking.report.sections.fitted_q import fitted_q_table
from tracking.run_folders.sweep import RunFolder

MOST_COEFFICIENTS = 300
"""Rows of the table of all coefficients that the page shows."""


def correlation_section(
    run: RunFolder,
    found: list[Group],
    means: pd.DataFrame,
    correlations: pd.DataFrame,
    errors: pd.DataFrame,
    surrogates: pd.DataFrame,
) -> Section | None:
    """A point a placement, for every group and class; None for a sweep without detectors.

    Args:
        means: `tracking.findings.summary.seed_means` of the run.
        correlations: `tracking.findings.ceiling.beside` of the run.
        errors: `tracking.findings.leave_one_out.leave_one_out` of the run.
        surrogates: `tracking.findings.generalist.with_judgements` of the run.
    """
    if not has_detectors(run):
        return None
    tested = int(correlations["pairs_tested"].iloc[0]) if len(correlations) else 0
    section = Section(
        "Did the surrogates predict AP and recall?",
        [
            "A point is a placement, its bar a 95 % interval of the mean over seeds, for comparing "
            "it with the others: thick bars of the first section. ρ is "
            "Spearman's, with its 95 % interval over placements and seeds and its permutation "
            "p-value, both sides; r is Pearson's, τ Kendall's. The range is that of ρ without one "
            "placement in turn. No sign is assumed.",
            f"{tested} pairs of a surrogate and a metric were tested: about {0.05 * tested:.0f} "
            "would have p < 0.05 by chance alone if none were related. Within a class, IG and "
            "residual entropy order placements as S-MIG does, and covered entropy the other way "
            "round: they are one test, not four.",
            CEILING_IN_A_LINE,
        ],
        folded=True,
    )
    if run.promotions is not None and len(run.promotions):
        section.notes.append(
            "Only placements that were promoted were trained in full. A surrogate that chose them "
            "varies less among them than among all: its coefficient here is not that over all."
        )
    keys = [*group_columns(run.axes), "surrogate"]
    left_out = errors[[*keys, "spearman_min", "spearman_max"]]
    tested_and_left_out = correlations.merge(left_out, on=keys, how="left")
    summed = with_sums(surrogates, run.axes)
    order = list(run.placements)
    for group in found:
        for name in (*run.classes, "all"):
            own, tests = (
                judged(group.of(part), run.results, name) for part in (means, tested_and_left_out)
            )
            title = text(class_label(name))
            title += f" · {text(group.title)}" if group.varies else ""
            if not (tests["n"] > 0).any():
                continue
            predictors = surrogates_of(summed, group.place, name)
            section.figures.append(scatter(own, predictors, tests, title, order))
    if run.expected_ig_by_q is not None:
        fitted = fitted_q_table(run, run.expected_ig_by_q, found, means)
        section.tables += [fitted] if fitted else []
    if len(correlations):
        section.tables.append(correlation_table(correlations, run.axes).first(MOST_COEFFICIENTS))
    return section


def correlation_table(correlations: pd.DataFrame, axes: Sequence[str]) -> Table:
    """Every coefficient with interval and p-value."""
    columns = [
        words("class"),
        words("detector"),
        *(words(axis.rsplit(".", 1)[-1], axis) for axis in axes),
        METRIC,
        SURROGATE,
        numbers("n", "n", ""),
        numbers("seeds", "seeds", ""),
        Column("Pearson r", partial(_with_interval, "pearson")),
        numbers("p", "pearson_p", ".2g"),
        Column("Spearman ρ", partial(_with_interval, "spearman")),
        *([CEILING] if "ceiling" in correlations.columns else []),
        numbers("p", "spearman_p", ".2g"),
        numbers("p, Holm", "spearman_holm", ".2g"),
        Column("Kendall τ", partial(_with_interval, "kendall")),
        numbers("p", "kendall_p", ".2g"),
        words("note"),
    ]
    return Table.of(
        "All coefficients, 95 % intervals in brackets",
        correlations,
        columns,
        wide=True,
        name="coefficients",
    )


def _with_interval(kind: str, row: Mapping[Any, Any]) -> str:
    value, low, high = (row[f"{kind}{suffix}"] for suffix in ("", "_low", "_high"))
    return "–" if np.isnan(value) else f"{signed(value)} {interval(low, high)}"
