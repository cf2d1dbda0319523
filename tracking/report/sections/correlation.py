"""The section of surrogates against AP and recall, over placements, and of a fitted q."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.named_points import add_placements, label_places
from tracking.figures.kit.style import add_menu, broken, figure, text
from tracking.findings.groups import Group, has_detectors
from tracking.findings.paired import group_columns, with_sums
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import judged
from tracking.labels import (
    in_order,
    interval,
    metric_label,
    signed,
    surrogate_label,
    surrogate_name,
)
from tracking.pages.section import (
    METRIC,
    SURROGATE,
    Column,
    Section,
    Table,
    coefficient,
    numbers,
    words,
)
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.ceiling import CEILING, CEILING_IN_A_LINE
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.straight_line import best_line, left_out_means, left_out_predictions, rmse

MOST_COEFFICIENTS = 300
"""Rows of the table of all coefficients that the page shows."""


def correlation_section(found: Analysis) -> Section | None:
    """A point a placement, for every group and class; None for a sweep without detectors."""
    run, correlations, means = found.run, found.correlations, found.means
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
    left_out = found.errors[[*keys, "spearman_min", "spearman_max"]]
    tested_and_left_out = correlations.merge(left_out, on=keys, how="left")
    summed = with_sums(found.surrogates, run.axes)
    order = list(run.placements)
    for group in found.groups:
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
        fitted = fitted_q_table(run, run.expected_ig_by_q, found.groups, means)
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
        coefficient("Pearson r", "pearson"),
        numbers("p", "pearson_p", ".2g"),
        coefficient("Spearman ρ", "spearman"),
        *([CEILING] if "ceiling" in correlations.columns else []),
        numbers("p", "spearman_p", ".2g"),
        numbers("p, Holm", "spearman_holm", ".2g"),
        coefficient("Kendall τ", "kendall"),
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


def scatter(
    metric: pd.DataFrame,
    surrogates: pd.DataFrame,
    correlations: pd.DataFrame,
    title: str,
    placements: Sequence[str],
) -> go.Figure:
    """Points labelled by placement, bars of 95 % intervals for a comparison, a menu of surrogates.

    Args:
        metric: rows of `seed_means` for one class, detector, metric, IoU and setting.
        surrogates: placements as rows, surrogates as columns (`surrogates_of`).
        correlations: rows of `correlate` beside their ceilings, with those of `leave_one_out` for
            the same; its surrogates make the menu. The first of the largest |rho| is shown at the
            start.
    """
    known = {row["surrogate"]: row for row in correlations.to_dict("records")}
    menu = [name for name in in_order(known) if known[name]["n"] > 0]
    strength = [np.nan_to_num(abs(known[name]["spearman"])) for name in menu]
    first = int(np.argmax(strength))
    table = metric[metric["seeds"] > 0].set_index("placement").join(surrogates, how="inner")
    table = table.loc[[name for name in placements if name in table.index]]
    names = [str(name) for name in table.index]
    label = metric_label(*metric.iloc[0][["metric", "iou"]])

    heads = [
        f'{title}<br><span style="font-size:12px">{_coefficient(known[name])}</span>'
        for name in menu
    ]

    def places(surrogate: str) -> list[str]:
        x, y = table[surrogate].to_numpy(np.float64), table["mean"].to_numpy(np.float64)
        return label_places(x, y, names, table["half"].to_numpy(np.float64))

    plot = figure(heads[first], height=400, margin={"t": 120})
    add_placements(
        plot,
        table[menu[first]],
        table["mean"],
        table["half"],
        names,
        placements,
        hovertemplate="%{text}<br>%{x:.6g}<br>%{y:.2f} %<extra></extra>",
    )
    plot.update_xaxes(title=surrogate_label(menu[first]))
    plot.update_yaxes(title=f"{label} (%)")
    changes = [
        (
            {"x": [table[name].to_list()], "textposition": [places(name)]},
            {
                "title.text": broken(head),
                "xaxis.title.text": surrogate_label(name),
                "xaxis.autorange": True,
            },
        )
        for name, head in zip(menu, heads, strict=True)
    ]
    add_menu(plot, [surrogate_name(name) for name in menu], changes, first, y=1.02)
    return plot


def _coefficient(row: Mapping[Hashable, Any]) -> str:
    if np.isnan(row["spearman"]):
        return text(row["note"])
    rho = (
        f"ρ = {signed(row['spearman'])} "
        f"{interval(row['spearman_low'], row['spearman_high'])}, "
        f"p = {row['spearman_p']:.2g}, n = {row['n']}"
    )
    if np.isfinite(row["ceiling"]):
        rho += f", ceiling {row['ceiling']:.2f}"
    others = f"r = {signed(row['pearson'])}, τ = {signed(row['kendall'])}"
    if np.isnan(row["spearman_min"]):
        return f"{rho}<br>{others}"
    span = f"{signed(row['spearman_min'])} to {signed(row['spearman_max'])}"
    return f"{rho}<br>{others}; one left out: ρ {span}"


LEAST_PLACEMENTS = 4
"""With fewer, a line and q pass through all points that are left."""


def fitted_q_table(
    run: RunFolder, by_q: pd.DataFrame, found: Sequence[Group], means: pd.DataFrame
) -> Table | None:
    """How well expected IG predicts headline AP with a fitted q; None for too few placements.

    Args:
        by_q: `expected_ig_by_q.parquet`: placement, axes, class, q, expected_ig.
        means: `tracking.findings.summary.seed_means`.
    """
    rows = []
    for group in found:
        for name in run.classes:
            own = judged(group.of(means), run.results, name)
            measured: pd.Series = own.set_index("placement")["mean"].dropna()
            gains = surrogates_of(by_q, group.setting, name, "q", "expected_ig")
            common = measured.index.intersection(gains.index)
            if len(common) < LEAST_PLACEMENTS:
                continue
            fitted = fit_detection_probability(gains.loc[common], measured.loc[common])
            left_out = fitted.placements["q"]
            rows.append(
                {
                    "title": group.title,
                    "class": name,
                    "detector": group.detector,
                    **group.setting,
                    "q": fitted.q,
                    "q_one_left_out_min": left_out.min(),
                    "q_one_left_out_max": left_out.max(),
                    "rmse (points)": fitted.rmse,
                    "rmse_of_mean (points)": fitted.rmse_of_mean,
                }
            )
    if not rows:
        return None
    table = pd.DataFrame(rows)
    rmse, of_mean = "rmse (points)", "rmse_of_mean (points)"
    columns = [
        words("class"),
        words("detector", "title"),
        numbers("q", "q", ".2g"),
        Column(
            "q, one left out",
            lambda row: f"{row['q_one_left_out_min']:.2g} to {row['q_one_left_out_max']:.2g}",
        ),
        numbers("RMSE", rmse, ".2f"),
        numbers("RMSE of the mean", of_mean, ".2f"),
        Column(
            "than the mean",
            lambda row: "better" if row[rmse] < row[of_mean] else "not better",
            words=True,
        ),
    ]
    return Table.of(
        "q of expected IG fitted to 3D AP; each placement predicted from the others, errors in AP",
        table,
        columns,
        name="fitted-q",
        data=table.drop(columns="title"),
    )


@dataclass(frozen=True)
class FittedDetectionProbability:
    """Result of `fit_detection_probability`.

    Attributes:
        q: fitted to all placements.
        placements: a row a placement: `measured`, `q` fitted without it, and `predicted` from the
            others; index placement.
        rmse: of the predictions, in the unit of the measured metric.
        rmse_of_mean: of predicting each placement by the mean of the others; a surrogate that
            says anything has a smaller `rmse`.
    """

    q: float
    placements: pd.DataFrame
    rmse: float
    rmse_of_mean: float


def fit_detection_probability(
    expected_ig: pd.DataFrame, measured: pd.Series
) -> FittedDetectionProbability:
    """Fit q of `expected_ig` to a measured metric, leaving one placement out at a time.

    For every q the metric is a straight line of `expected_ig` by least squares, of either sign;
    the q of the smallest residual wins. For each placement this is done with the others, and their
    line predicts its metric.

    Args:
        expected_ig: a row a placement (index), a column a q; nats, finite.
            `lidarplace.expected_ig_by_q` computes the rows.
        measured: AP or recall by placement (same index in any order, at least
            `LEAST_PLACEMENTS`), percent.
    """
    gains = expected_ig.to_numpy(np.float64)
    metric = measured.reindex(expected_ig.index).to_numpy(np.float64)
    qs = expected_ig.columns.to_numpy(np.float64)

    predicted, chosen = left_out_predictions(gains, metric)
    table = pd.DataFrame(
        {"measured": metric, "q": qs[chosen], "predicted": predicted}, index=expected_ig.index
    )
    return FittedDetectionProbability(
        q=float(qs[best_line(gains, metric)[0]]),
        placements=table,
        rmse=rmse(predicted, metric),
        rmse_of_mean=rmse(left_out_means(metric), metric),
    )
