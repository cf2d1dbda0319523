"""The tables of a report, as cells of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tracking.detection_probability import LEAST_PLACEMENTS, fit_detection_probability
from tracking.labels import (
    in_order,
    interval,
    metric_label,
    signed,
    surrogate_label,
    surrogate_name,
)
from tracking.report.groups import Group
from tracking.report.headline import HEADLINE_METRIC, plus_minus
from tracking.run_folder import RunFolder
from tracking.summary import by_surrogate, headline_iou, surrogates_of

MOST_ROWS = 50
"""Placements and trials that a table shows; a page must stay small."""


@dataclass(frozen=True)
class Table:
    """Text cells under a caption; many rows are shown in a box that scrolls.

    Attributes:
        caption: one line above the table.
        head: names of the columns.
        rows: cells, as many in each row as in `head`.
        best: (row, column) of cells to stress.
        words: columns of words, the others hold numbers.
        wide: its head is not broken into lines.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    words: frozenset[int] = frozenset({0})
    wide: bool = False

    def first(self, most: int, file: str) -> Table:
        """The first `most` rows; the caption then says so, and that `file` has all of them."""
        if len(self.rows) <= most:
            return self
        caption = f"{self.caption} · the first {most} of {len(self.rows):,} rows, all in {file}"
        best = frozenset(cell for cell in self.best if cell[0] < most)
        return replace(self, caption=caption, rows=self.rows[:most], best=best)


def placement_table(
    run: RunFolder, group: Group, means: pd.DataFrame, object_class: str
) -> Table | None:
    """Surrogates, AP and recall of every placement for one class, best headline AP first.

    Placements without AP follow in the order of `by_surrogate`; where none has any result, ranks
    stand behind the surrogates. Class "all" has recall only. None if there is neither a result nor
    a surrogate.
    """
    own = group.of(means)
    own = own[own["class"] == object_class]
    surrogates = surrogates_of(run.surrogates, group.setting, object_class)
    metrics = own[["metric", "iou"]].drop_duplicates().sort_values(["metric", "iou"])
    if own.empty and surrogates.empty:
        return None
    known = {*own["placement"], *surrogates.index}
    in_sequence = dict.fromkeys((*by_surrogate(run.surrogates), *run.placements))
    names = [name for name in in_sequence if name in known]
    columns: list[tuple[str, list[str], np.ndarray]] = []
    order = None
    for metric, iou in metrics.itertuples(index=False):
        match = (own["metric"] == metric) & (own["iou"] == iou)
        cells = own[match].set_index("placement")[["mean", "sd"]].reindex(names)
        texts = [plus_minus(mean, sd) for mean, sd in cells.itertuples(index=False)]
        columns.append((f"{metric_label(metric, iou)} (%)", texts, cells["mean"].to_numpy()))
        if order is None or iou == headline_iou(run.results, object_class):
            order = cells["mean"] if order is None or metric == "AP_R40_3D" else order
    caption = "All classes" if object_class == "all" else object_class
    caption += f" · {group.title}" if group.varies else ""
    if "h_pog" in surrogates.columns and surrogates["h_pog"].nunique() == 1:
        caption += f" · H_POG = {number(surrogates['h_pog'].iloc[0])} nats"
        surrogates = surrogates.drop(columns="h_pog")
    for surrogate in in_order(surrogates.columns):
        of_placement = surrogates[surrogate].reindex(names)
        columns.append(
            (
                surrogate_label(surrogate),
                _with_ranks(of_placement) if own.empty else [number(v) for v in of_placement],
                np.full(len(names), np.nan),
            )
        )
    sequence = list(range(len(names)))
    if order is not None:
        sequence = np.argsort(-order.to_numpy(), kind="stable").tolist()
    rows = tuple((names[i], *(texts[i] for _, texts, _ in columns)) for i in sequence)
    best = set()
    for column, (_, _, values) in enumerate(columns, start=1):
        if np.isfinite(values).any():
            best.add((sequence.index(int(np.nanargmax(values))), column))
    head = ("placement", *(title for title, _, _ in columns))
    return Table(caption, head, rows, frozenset(best))


def _with_ranks(values: pd.Series) -> list[str]:
    """Numbers with their rank in brackets, 1 the highest."""
    ranks = values.rank(ascending=False, method="min")
    return [
        number(value) if np.isnan(rank) else f"{number(value)} ({rank:.0f})"
        for value, rank in zip(values, ranks, strict=True)
    ]


def correlation_table(correlations: pd.DataFrame, axes: Sequence[str]) -> Table:
    """Every coefficient with interval and p-value."""
    head = (
        *("class", "detector", *(axis.rsplit(".", 1)[-1] for axis in axes), "metric", "surrogate"),
        *("n", "seeds", "Pearson r", "p", "Spearman ρ", "p", "Kendall τ", "p", "note"),
    )
    rows = []
    for row in correlations.to_dict("records"):
        estimates = []
        for name in ("pearson", "spearman", "kendall"):
            value, low, high = (row[f"{name}{suffix}"] for suffix in ("", "_low", "_high"))
            known = not np.isnan(value)
            estimates.append(f"{signed(value)} {interval(low, high)}" if known else "–")
            estimates.append(f"{row[f'{name}_p']:.2g}" if known else "–")
        rows.append(
            (
                *(str(row[key]) for key in ("class", "detector", *axes)),
                metric_label(row["metric"], row["iou"]),
                surrogate_name(row["surrogate"]),
                *(str(row["n"]), str(row["seeds"]), *estimates, row["note"]),
            )
        )
    words = frozenset({*range(4 + len(axes)), len(head) - 1})
    return Table(
        "All coefficients, 95 % intervals in brackets", head, tuple(rows), words=words, wide=True
    )


def trial_table(trials: pd.DataFrame, axes: Sequence[str]) -> Table:
    """The trials that did not finish, with their errors."""
    columns = ["placement", "detector", "seed", *axes, "status", "error"]
    rows = tuple(
        tuple(str(cell) for cell in row) for row in trials[columns].itertuples(index=False)
    )
    words = frozenset(range(len(columns)))
    return Table("Trials that did not finish", tuple(columns), rows, words=words)


def accuracy_table(summary: pd.DataFrame, title: str) -> Table:
    """`tracking.accuracy.summarise` of one class as text."""
    head = (
        *("surrogate", "method", "resolution (m)", "azimuth steps", "frames", "error (%)"),
        *("worst (%)", "same resolution (%)", "Spearman ρ", "Kendall τ", "seconds", "POG seconds"),
    )
    rows = []
    for row in summary.to_dict("records"):
        errors = (row["median_error"], row["worst_error"], row["median_method_error"])
        ranks = (row["spearman"], row["kendall"])
        rows.append(
            (
                surrogate_name(str(row["surrogate"])),
                str(row["method"]) + (" (reference)" if row["reference"] else ""),
                f"{row['resolution']:g}",
                f"{row['azimuth_steps']:,}" if row["azimuth_steps"] else "all",
                f"{row['frames']:,}",
                *("–" if np.isnan(e) else f"{100 * e:.3g}" for e in errors),
                *("–" if np.isnan(r) else signed(r) for r in ranks),
                *(f"{row[key]:.3g}" for key in ("seconds", "pog_seconds")),
            )
        )
    caption = f"Rank agreement with the reference and errors · {title}"
    return Table(caption, head, tuple(rows), words=frozenset({0, 1}), wide=True)


def training_cost_table(summary: pd.DataFrame, axes: Sequence[str], title: str) -> Table:
    """`tracking.training_cost.summarise_cost` of one class and setting as text."""
    head = (
        *("detector", *(axis.rsplit(".", 1)[-1].replace("_", " ") for axis in axes), "trials"),
        *("seconds", "3D AP (%)", "below the longest", "Kendall τ"),
    )
    rows = tuple(
        (
            str(row["detector"]) + (" (longest)" if row["reference"] else ""),
            *(f"{row[axis]:g}" for axis in axes),
            str(row["trials"]),
            f"{row['seconds']:.3g}",
            f"{row['ap']:.1f}",
            "–" if row["reference"] else plus_minus(row["error"], row["error_sd"]),
            "–" if row["reference"] or np.isnan(row["kendall"]) else signed(row["kendall"]),
        )
        for row in summary.to_dict("records")
    )
    caption = f"Means over placements and seeds, rank agreement of the placements · {title}"
    return Table(caption, head, rows)


def efficiency_table(efficiency: pd.DataFrame, cores: int) -> Table:
    """`tracking.efficiency.stage_efficiency` as text."""
    head = (
        *("stage", "tasks", "task seconds", "wall seconds", "parallel efficiency"),
        *("overhead a task (ms)", "peak memory (MB)"),
    )
    rows = tuple(
        (
            str(row["stage"]),
            f"{row['tasks']:,}",
            *(f"{row[key]:,.1f}" for key in ("task_seconds", "wall")),
            "–" if np.isnan(row["efficiency"]) else f"{row['efficiency']:.2f}",
            f"{1000 * row['overhead']:,.1f}".replace("-", "−"),
            "–" if np.isnan(row["peak_memory"]) else f"{row['peak_memory'] / 1e6:,.0f}",
        )
        for row in efficiency.to_dict("records")
    )
    return Table(f"Parallel efficiency on {cores} cores", head, rows)


def sampling_error_table(estimates: pd.DataFrame, title: str) -> Table:
    """Estimates of `lidarplace.sampling_error` of one class as text."""
    head = ("surrogate", "placement", "value", "sd", "bias", "95 % low", "95 % high")
    order = in_order(estimates["surrogate"])
    rows = tuple(
        (
            surrogate_label(str(row["surrogate"])),
            str(row["placement"]),
            *(number(row[key]) for key in ("value", "sd", "bias", "low", "high")),
        )
        for row in sorted(
            estimates.to_dict("records"), key=lambda row: order.index(row["surrogate"])
        )
    )
    caption = f"Sampling error · {title}"
    if "blocks" in estimates:
        caption += (
            f" · {estimates['resamples'].iloc[0]} draws of {estimates['blocks'].iloc[0]} blocks"
        )
    return Table(caption, head, rows, words=frozenset({0, 1}), wide=True)


def fitted_q_table(
    run: RunFolder, by_q: pd.DataFrame, found: Sequence[Group], means: pd.DataFrame
) -> Table | None:
    """How well expected IG predicts headline AP with a fitted q; None for too few placements.

    Args:
        by_q: `expected_ig_by_q.parquet`: placement, axes, class, q, expected_ig.
        means: `tracking.summary.seed_means`.
    """
    rows = []
    for group in found:
        for name in run.classes:
            own = group.of(means)
            own = own[(own["class"] == name) & (own["metric"] == HEADLINE_METRIC)]
            own = own[own["iou"] == headline_iou(run.results, name)]
            measured: pd.Series = own.set_index("placement")["mean"].dropna()
            gains = surrogates_of(by_q, group.setting, name, "q", "expected_ig")
            common = measured.index.intersection(gains.index)
            if len(common) < LEAST_PLACEMENTS:
                continue
            fitted = fit_detection_probability(gains.loc[common], measured.loc[common])
            left_out = fitted.placements["q"]
            rows.append(
                (
                    name,
                    group.title,
                    f"{fitted.q:.2g}",
                    f"{left_out.min():.2g} to {left_out.max():.2g}",
                    f"{fitted.rmse:.2f}",
                    f"{fitted.rmse_of_mean:.2f}",
                    "better" if fitted.rmse < fitted.rmse_of_mean else "not better",
                )
            )
    if not rows:
        return None
    head = (
        "class",
        "detector",
        "q",
        "q, one left out",
        "RMSE",
        "RMSE of the mean",
        "than the mean",
    )
    caption = (
        "q of expected IG fitted to 3D AP; each placement predicted from the others, errors in AP"
    )
    return Table(caption, head, tuple(rows), words=frozenset({0, 1, 6}))


def number(value: float) -> str:
    """Five significant digits, thousands separated; a dash for no number."""
    if not np.isfinite(value):
        return "–"
    digits = max(0, 4 - int(np.floor(np.log10(abs(value))))) if value else 0
    return f"{value:,.{min(digits, 8)}f}".replace("-", "−")
