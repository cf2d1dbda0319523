"""The section that compares the surrogates: which predicts best, and where none does."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import headline_metric
from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.figures.kit.style import (
    OUTLINE,
    colour,
    figure,
    legend_below,
    symbol,
    text,
    two_lines,
)
from tracking.figures.of_sweeps.heat_map import heat_map
from tracking.findings.best_surrogate import SIGNIFICANT, Predictors
from tracking.findings.generalist import JUDGEMENTS
from tracking.findings.groups import has_detectors
from tracking.kitti_iou import headline_iou, judged_by_all
from tracking.labels import (
    detector_label,
    in_order,
    interval,
    metric_label,
    setting_label,
    signed,
    span,
    surrogate_name,
)
from tracking.pages.section import METRIC, SURROGATE, Column, Section, Table, numbers, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.ceiling import CEILING, CEILING_IN_A_LINE
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.coefficients import smallest_p
from tracking.statistics.power import power_table, smallest_detectable

MOST_SENTENCES = 8
"""Findings that are listed one by one; more are counted, and the table of the section has each."""

_HOW_TO_READ = (
    "Left: Spearman's ρ; a star where p is below 0.05 after Holm's correction for all tests of "
    "this sweep. Right: each placement's metric predicted by a straight line through the "
    "others, the error over that of predicting their mean: right of the dotted line a surrogate "
    "is worse than none. Surrogates with the same or the reverse order of another one here are "
    "left out: they are the same test."
)


def predictors_section(found: Analysis) -> Section | None:
    """Figures and findings for every class; None for a sweep without detectors."""
    run, correlations, errors = found.run, found.correlations, found.errors
    if not has_detectors(run):
        return None
    section = Section("Which surrogate predicts best?", columns=2)
    if not found.predicted:
        section.notes.append("Fewer than 3 placements with a metric: no coefficient.")
        return section
    own = [one for one in found.predicted if _is_headline(run, one)]
    said = [" · ".join(filter(None, (_group_label(run, one.group), one.sentence))) for one in own]
    many = len(own) > MOST_SENTENCES
    section.notes += [counted(run, found.predicted, correlations)] if many else said
    section.notes += [*_power_sentences(correlations), CEILING_IN_A_LINE, _HOW_TO_READ]
    strongest = (str(one.ranking.index[0]) for one in own)  # which the findings name
    shown = {*HEADLINE_SURROGATES, *JUDGEMENTS, *strongest}
    for name in (*run.classes, "all"):
        title = text(class_label(name))
        tests, misses = (
            judged_by_all(table[table["surrogate"].isin(shown)], run.results, name)
            for table in (correlations, errors)
        )
        if _varying(run):
            misses = misses[misses["metric"] == headline_metric(name)]
        plots = [
            heat_map(tests, _labels(run, tests), f"ρ · {title}"),
            left_out(misses.assign(label=_labels(run, misses)), f"Left-out error · {title}"),
        ]
        section.figures += [plot for plot in plots if plot is not None]
    section.tables.append(_ranking_table(found))
    section.tables.append(_power_table(correlations))
    return section


def _is_headline(run: RunFolder, one: Predictors) -> bool:
    """Whether it is about 3D AP of a class, or recall of all, at the headline IoU."""
    name = str(one.group["class"])
    iou = headline_iou(run.results, name)
    return one.group["metric"] == headline_metric(name) and one.group["iou"] == iou


def counted(run: RunFolder, found: Sequence[Predictors], correlations: pd.DataFrame) -> str:
    """In how many cases which surrogate predicts, and whether any could have been shown to."""
    own = [one for one in found if _is_headline(run, one)]
    shown = Counter(surrogate_name(one.predictor) for one in own if one.predictor)
    names = ", ".join(f"{name} {count}" for name, count in shown.most_common())
    return (
        f"In {shown.total()} of {len(own)} cases (a class, detector and setting) a surrogate is "
        f"shown to predict 3D AP, or recall of all objects{f': {names}' if names else ''}."
        + _beyond_proof(own, correlations)
    )


def _beyond_proof(own: Sequence[Predictors], correlations: pd.DataFrame) -> str:
    """In how many of the cases not even a perfect order could pass the correction."""
    tests = int(correlations["spearman_tests"].max())
    keys = list(own[0].group) if own else []
    cases = pd.DataFrame([one.group for one in own], columns=keys)
    known = correlations[correlations["spearman"].notna()]
    sizes = cases.merge(known.groupby(keys, dropna=False)["n"].max().reset_index())["n"]
    few = sizes[[smallest_p(int(n)) * tests > SIGNIFICANT for n in sizes]]
    if few.empty:
        return ""
    numbers = " or ".join(map(str, sorted(few.unique())))
    where = "" if len(few) == len(own) else f"in {len(few)} of them "
    return (
        f" With {numbers} placements and {tests} tests {where}not even a perfect order could be "
        "shown."
    )


def _varying(run: RunFolder) -> list[str]:
    """Detector and further axes, those that the results have several values of."""
    return [
        axis
        for axis in ("detector", *run.axes)
        if axis in run.results and run.results[axis].nunique(dropna=False) > 1
    ]


def _group_label(run: RunFolder, group: Mapping[Any, Any]) -> str:
    """Detector and setting, as far as the sweep has several of them."""
    varying = _varying(run)
    axes = [axis for axis in varying if axis != "detector"]
    return (detector_label if "detector" in varying else setting_label)(axes, group)


def _labels(run: RunFolder, table: pd.DataFrame) -> list[str]:
    """Metric, and detector and setting where the sweep has several of them."""
    return [
        " · ".join(filter(None, (metric_label(row["metric"], row["iou"]), _group_label(run, row))))
        for row in table.to_dict("records")
    ]


def _power_sentences(correlations: pd.DataFrame) -> list[str]:
    """What so many placements can show, one sentence for every number of placements."""
    known = correlations[correlations["spearman"].notna()]
    said = []
    for n, part in known.groupby("n"):
        least = smallest_detectable(int(str(n)), "spearman", _reliability(part))
        found = (
            f"only a |ρ| above {least:.2f} in the population would be found"
            if np.isfinite(least)
            else "no correlation, however strong, would be found"
        )
        said.append(
            f"With {n} placements {found} with a probability of 80 % (two-sided test at 5 %, "
            "before any correction for many tests)."
        )
    return said


def _reliability(part: pd.DataFrame) -> float:
    """Median over tests of the reliability of a mean over seeds; 1 where one seed hides it."""
    known = part["reliability"].dropna()
    return float(known.median()) if len(known) else 1.0


def _power_table(correlations: pd.DataFrame) -> Table:
    known = correlations[correlations["spearman"].notna()]
    reliability = _reliability(known)
    here = known["n"].unique().tolist()
    table = power_table(sorted({*here, 6, 8, 12, 20, 50}), reliability)
    heads = {"pearson": "Pearson |r|", "spearman": "Spearman |ρ|"}

    def least(value: float) -> str:
        return "none" if np.isnan(value) else f"{value:.2f}"

    columns = [
        numbers("placements", "n", ",.0f"),
        *(numbers(head, key, least) for key, head in heads.items()),
    ]
    caption = (
        "Smallest correlation that a test finds with a probability of 80 %, metrics as reliable as "
        f"here ({reliability:.2f})"
    )
    return Table.of(caption, table, columns, name="power")


def _ranking_table(found: Analysis) -> Table:
    run, predicted = found.run, found.predicted
    keys = [*predicted[0].group, "surrogate"]
    ranges = found.errors[[*keys, "spearman_min", "spearman_max"]]
    most = found.correlations[[*keys, "ceiling", "ceiling_low", "ceiling_high"]]
    table = pd.concat([_with_group(one) for one in predicted])
    table = table.merge(ranges, how="left", on=keys).merge(most, how="left", on=keys)
    headline = np.repeat(
        [_is_headline(run, one) for one in predicted], [len(o.ranking) for o in predicted]
    )

    def behind(row: Mapping[Any, Any]) -> str:
        low, high = row["behind_low"], row["behind_high"]
        return "–" if np.isnan(low) else f"{row['behind']:.2f} {interval(low, high)}"

    columns = [
        words("class"),
        Column("detector", partial(detector_label, run.axes), words=True),
        METRIC,
        SURROGATE,
        numbers("ρ", "spearman", signed),
        CEILING,
        numbers("p", "p", ".2g"),
        numbers("p, Holm", "holm", ".2g"),
        Column("ρ, one left out", lambda r: span(r["spearman_min"], r["spearman_max"], "+z.2f")),
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


def _with_group(one: Predictors) -> pd.DataFrame:
    """The ranking with the columns of its group."""
    group: dict[str, Any] = one.group
    return one.ranking.rename_axis("surrogate").reset_index().assign(**group)


def left_out(errors: pd.DataFrame, title: str) -> go.Figure | None:
    """Error of a line through the other placements over that of their mean, a colour a surrogate.

    Args:
        errors: surrogate, rmse and rmse_of_mean of `tracking.findings.correlation`, and `label`:
            what the row of the figure is called, once for each surrogate.

    Returns:
        None if there is no error at all.
    """
    known = errors[errors["rmse"].notna() & (errors["rmse_of_mean"] > 0)]
    if known.empty:
        return None
    labels = [two_lines(text(label)) for label in dict.fromkeys(known["label"])]
    names = in_order(known["surrogate"])
    plot = figure(title, height=140 + 34 * len(labels))
    for i, name in enumerate(names):
        own = known[known["surrogate"] == name]
        plot.add_scatter(
            x=(own["rmse"] / own["rmse_of_mean"]).to_numpy(),
            y=[two_lines(text(label)) for label in own["label"]],
            mode="markers",
            marker={"size": 10, "color": colour(i), "symbol": symbol(i)},
            name=surrogate_name(name),
            showlegend=True,
            customdata=own["rmse"].to_numpy(),
            hovertemplate="%{y}: %{x:.2f}, %{customdata:.2f} points<extra>%{fullData.name}</extra>",
        )
    plot.add_vline(x=1, line={"color": OUTLINE, "dash": "dot", "width": 1.5})
    plot.update_xaxes(title="error / error of the mean", rangemode="tozero")
    plot.update_yaxes(categoryorder="array", categoryarray=labels[::-1])
    legend_below(plot)
    return plot
