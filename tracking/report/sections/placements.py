"""Placements of a sweep: surrogates, AP and recall, and whether surrogates agree."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking import labels
from tracking.findings.groups import Group, has_detectors, met, worst_requirements
from tracking.findings.paired import with_sums
from tracking.findings.summary import by_surrogate, deciding_surrogate, surrogates_of
from tracking.kitti_iou import headline_iou
from tracking.pages.section import MOST_ROWS, Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder


def placements_section(analysis: Analysis) -> Section:
    """Show a table for every group and class, and the trials that failed."""
    run = analysis.run
    decides = labels.surrogate_name(deciding_surrogate(run.surrogates))
    several = run.results.empty or run.results["seed"].nunique() > 1
    means = "Mean ± standard deviation over seeds" if several else "One seed"
    with_results = f"{means}, best AP first; the highest of a column is bold."
    alone = (
        f"No detector was evaluated. Order: {decides}. "
        "Ranks in brackets, 1 the highest value. The ranks of S-MIG, IG and residual entropy run "
        "against those of covered entropy: only a detector shows which sign is better."
    )
    section = Section("Placements", [alone if run.results.empty else with_results])
    for group in analysis.groups:
        # Of one class the table has the recall of all objects, too.
        for name in run.classes if len(run.classes) == 1 else (*run.classes, "all"):
            table = _placement_table(run, group, analysis.means, name)
            if table is not None:
                section.tables.append(table.first(MOST_ROWS))
    failed = run.trials[run.trials["status"] == "failed"]
    if len(failed):
        names = ["placement", "detector", "seed", *run.axes, "status", "error"]
        columns, caption = [words(name) for name in names], "Trials that did not finish"
        table = Table.of(caption, failed[names], columns, name="failed-trials")
        section.tables.append(table.first(MOST_ROWS))
    return section


def _placement_table(
    run: RunFolder, group: Group, means: pd.DataFrame, object_class: str
) -> Table | None:
    """Show surrogates, AP and recall of every placement for one class, best headline AP first.

    Placements without AP follow in the order of `by_surrogate`; where none has any result, ranks
    stand behind the surrogates. None if there is neither a result nor a surrogate."""
    metric_rows = group.of(means)
    metric_rows = metric_rows[metric_rows["class"] == object_class]
    surrogates = surrogates_of(run.surrogates, group.setting, object_class)
    if metric_rows.empty and surrogates.empty:
        return None
    with_values = {*metric_rows["placement"], *surrogates.index}
    in_sequence = dict.fromkeys((*by_surrogate(run.surrogates), *run.placements))
    table = pd.DataFrame(
        index=pd.Index([n for n in in_sequence if n in with_values], name="placement")
    )
    columns = [words("placement")]
    highest: dict[int, str] = {}
    order = ""
    required = met(worst_requirements(run, group.setting)).reindex(table.index)
    if required.notna().any():
        table["requirements met"] = required
        counted = required.fillna(labels.DASH)
        columns.append(Column("requirements met", lambda row: counted[row["placement"]]))
    headline = (headline_metric(object_class), headline_iou(run.results, object_class))
    metrics = metric_rows[["metric", "iou"]].drop_duplicates().sort_values(["metric", "iou"])
    for metric, iou in metrics.itertuples(index=False):
        label = f"{labels.metric_label(metric, iou)} (%)"
        cells = metric_rows[
            (metric_rows["metric"] == metric) & (metric_rows["iou"] == iou)
        ].set_index("placement")
        for key in ("mean", "sd", "low", "high", "seeds"):
            table[f"{label} {key}"] = cells[key].reindex(table.index)
        highest[len(columns)] = f"{label} mean"
        columns.append(_mean_and_sd(label))
        if not order or (metric, iou) == headline:
            order = f"{label} mean"
    caption = group.label(class_label(object_class))
    if "h_pog" in surrogates.columns and surrogates["h_pog"].nunique() == 1:
        caption += f" · H_POG = {labels.number(surrogates['h_pog'].iloc[0])} nats"
        table["H_POG (nats)"] = surrogates["h_pog"].iloc[0]
        surrogates = surrogates.drop(columns="h_pog")
    for surrogate in labels.in_order(surrogates.columns):
        label = labels.surrogate_label(surrogate)
        table[label] = surrogates[surrogate].reindex(table.index)
        alone = metric_rows.empty
        columns.append(_with_rank(label, table) if alone else numbers(label, label, labels.number))
    if order:
        table = table.sort_values(order, ascending=False, kind="stable")
    best = {(int(np.nanargmax(table[k])), i) for i, k in highest.items() if table[k].notna().any()}
    return Table.of(
        caption,
        table.reset_index(),
        columns,
        best=frozenset(best),
        name=slug("placements", object_class, group.title if group.varies else ""),
    )


def _mean_and_sd(label: str) -> Column:
    return Column(label, lambda row: labels.plus_minus(row[f"{label} mean"], row[f"{label} sd"]))


def _with_rank(label: str, table: pd.DataFrame) -> Column:
    """Format a number with its rank among those of the table in brackets, 1 the highest."""
    ranks = table[label].rank(ascending=False, method="min")

    def cell(row: Mapping[Any, Any]) -> str:
        rank, value = ranks[row["placement"]], labels.number(row[label])
        return value if np.isnan(rank) else f"{value} ({rank:.0f})"

    return Column(label, cell)


def agreement_section(analysis: Analysis) -> Section | None:
    """Show how surrogates agree on the ranking; None for a sweep that trained a detector."""
    run = analysis.run
    if has_detectors(run):
        return None
    section = Section("Do the surrogates agree?", ["Spearman's ρ, over all placements."])
    sums = with_sums(run.surrogates, run.axes)
    names = (*run.classes, "all") if len(run.classes) > 1 else run.classes
    for group in analysis.groups:
        for name in names:
            title = group.label("Sum of the classes" if name == "all" else name)
            section.tables += _surrogate_agreement(surrogates_of(sums, group.setting, name), title)
    if not section.tables:
        section.notes = ["Fewer than 3 placements: no rank agreement."]
    return section


def _surrogate_agreement(surrogates: pd.DataFrame, title: str) -> list[Table]:
    """Correlate surrogates; [] for fewer than 3 placements, or fewer than 2 surrogates that vary.

    `surrogates` have placements as rows, surrogates as columns (`surrogates_of`)."""
    varying = surrogates[labels.in_order(surrogates.columns)].dropna(axis="columns", how="all")
    varying = varying.loc[:, varying.nunique() > 1]
    if len(varying) < 3 or varying.shape[1] < 2:
        return []
    rho = varying.corr("spearman")
    columns = [words("surrogate", show=labels.surrogate_name)]
    columns += [numbers(labels.surrogate_name(name), name, labels.signed) for name in rho.columns]
    rows = rho.rename_axis("surrogate").rename_axis(columns=None).reset_index()
    name = slug("agreement", title)
    return [Table.of(title, rows, columns, wide=True, name=name)]
