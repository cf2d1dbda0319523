"""The section that compares one detector for all rigs with detectors trained for each."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import headline_metric
from tracking.figures.kit.named_points import add_placements
from tracking.figures.kit.style import OUTLINE, figure, text
from tracking.findings.generalist import (
    CALIBRATION,
    JUDGEMENTS,
    compare,
    judgement_name,
    seconds_a_placement,
    training_seconds,
)
from tracking.findings.groups import JUDGE
from tracking.labels import interval, metric_label, setting_label, signed
from tracking.pages.section import (
    METRIC,
    Column,
    Section,
    Table,
    coefficient,
    in_points,
    numbers,
    words,
)
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.ceiling import CEILING
from tracking.report.sections.regret import AT_RANDOM, regret_table
from tracking.run_folders.sweep import RunFolder

_NOTE = (
    "The generalist is one detector, trained on other rigs, that evaluates each placement "
    "without a training for it. A point is a placement: AP or recall by the generalist, and by "
    "detectors that were trained for the placement. Only the order decides which placement is "
    "best. On the dotted line differences between placements are equal for both. They met the "
    "same test objects, so the ceiling is by the seeds of the own detectors alone. Bias: the "
    "generalist's less their own, mean over placements. Slope: by how many points their own "
    "differ where the generalist's differ by one. 95 % in brackets."
)
MOST_FIGURES = 12
_REGRETS = ("regret", "regret_low", "regret_high", "regret_at_random")


def generalist_section(found: Analysis) -> Section | None:
    """None unless the same placements were judged by a generalist and by detectors of their own."""
    run = found.run
    if not found.surrogates["surrogate"].isin(JUDGEMENTS).any():
        return None
    rows, pairs = compare(run, found.means, found.correlations)
    if rows.empty:
        return None
    rows = _with_regret(rows, regret_table(found), run.axes)
    section = Section("Does one detector for all rigs rank them as their own do?", [_NOTE])
    order = list(run.placements)
    for row, pair in zip(rows.to_dict("records"), pairs, strict=True):
        headline = row["metric"] == headline_metric(row["class"])
        if headline and len(section.figures) < MOST_FIGURES:
            title = " · ".join(filter(None, (class_label(row["class"]), _own(run, rows, row))))
            title = title[0].upper() + title[1:]
            section.figures.append(against_generalist(pair, row, text(title), order))
    section.tables = [_table(run, rows), _seconds(run)]
    section.notes += _once(training_seconds(run.tasks))
    return section


def _own(run: RunFolder, rows: pd.DataFrame, row: Mapping[Any, Any]) -> str:
    """Detector, its judge and setting, as far as there are several."""
    keys = ["detector", *run.axes]
    varying = [key for key in keys if rows[key].nunique(dropna=False) > 1]
    axes = [key for key in varying if key not in ("detector", JUDGE)]
    named = [str(row[key]) for key in ("detector", JUDGE) if key in varying]
    return ", ".join(filter(None, (*named, setting_label(axes, row))))


def _with_regret(rows: pd.DataFrame, regret: pd.DataFrame, axes: Sequence[str]) -> pd.DataFrame:
    """`rows` with what the generalist's choice and one at random lose; NaN where it is unknown."""
    if regret.empty:
        return rows.assign(**dict.fromkeys(_REGRETS, np.nan))
    keys = ["class", "detector", *axes, "metric", "iou"]
    own = regret[regret["surrogate"] == regret["metric"].map(judgement_name)]
    own = own[[*keys, "regret", "low", "high"]]
    own = own.rename(columns={"low": "regret_low", "high": "regret_high"})
    random = regret.loc[regret["surrogate"] == AT_RANDOM, [*keys, "regret"]]
    random = random.rename(columns={"regret": "regret_at_random"})
    return rows.merge(own, on=keys, how="left").merge(random, on=keys, how="left")


def _table(run: RunFolder, rows: pd.DataFrame) -> Table:
    several = any(_own(run, rows, row) for row in rows.to_dict("records"))
    columns = [
        words("class"),
        *([Column("own detectors", lambda r: _own(run, rows, r), words=True)] if several else []),
        METRIC,
        coefficient("ρ", "spearman"),
        numbers("p", "spearman_p", ".2g"),
        CEILING,
        in_points("bias (points)", CALIBRATION[:3], "+z.1f"),
        coefficient("slope", "slope"),
        in_points("regret (points)", _REGRETS[:3], "z.1f"),
        numbers("at random", "regret_at_random", "z.1f"),
    ]
    gone = ["surrogate", "pairs_tested", "exact"]
    return Table.of(
        "The generalist against the placements' own detectors",
        rows,
        columns,
        name="generalist",
        data=rows.drop(columns=gone),
        units=dict.fromkeys(("bias", "bias_low", "bias_high", *_REGRETS), "points"),
    )


def _seconds(run: RunFolder) -> Table:
    table = seconds_a_placement(run.trials)
    columns = [
        words("judge", JUDGE),
        words("detector"),
        numbers("trials", "trials", ",.0f"),
        numbers("seconds of a placement and seed", "seconds", ",.3g"),
    ]
    return Table.of(
        "Cost of an evaluation: by the generalist; by own detectors, training included",
        table,
        columns,
        name="generalist-seconds",
        units={"seconds": "s"},
    )


def _once(seconds: pd.Series) -> list[str]:
    if seconds.empty:
        return []
    many = f"{len(seconds)} trainings of a generalist" if len(seconds) > 1 else "one training"
    return [f"Before its first judgement: {many}, {seconds.sum():,.0f} s together, without clouds."]


def against_generalist(
    pairs: pd.DataFrame, row: Mapping[Hashable, Any], title: str, placements: Sequence[str]
) -> go.Figure:
    """A point a placement with 95 % intervals for a comparison.

    On the line the generalist is off by its bias alone. Equal values may be far from all points.

    Args:
        pairs: `tracking.findings.generalist.side_by_side`.
        row: of `tracking.findings.generalist.compare`.
    """
    said = str(row["note"])
    if np.isfinite(row["spearman"]):
        span = interval(row["spearman_low"], row["spearman_high"])
        said = f"ρ = {signed(row['spearman'])} {span}, n = {row['n']}"
    if np.isfinite(row["ceiling"]):
        said += f", ceiling {row['ceiling']:.2f}"
    shown = f'<br><span style="font-size:12px">{text(said)}</span>'
    plot = figure(title + shown, height=400, margin={"t": 64})
    table = pairs.loc[[name for name in placements if name in pairs.index]]
    names = [str(name) for name in table.index]
    x, y = (table[key].to_numpy(np.float64) for key in ("said", "own"))
    ends = np.array([x.min(), x.max()])
    plot.add_scatter(
        x=ends,
        y=ends - row["bias"],
        mode="lines",
        line={"color": OUTLINE, "width": 1, "dash": "dot"},
        hoverinfo="skip",
        showlegend=False,
    )
    add_placements(
        plot,
        x,
        y,
        table["own_half"],
        names,
        placements,
        table["said_half"],
        hovertemplate="%{text}<br>generalist %{x:.2f} %<br>own detectors %{y:.2f} %<extra></extra>",
    )
    label = metric_label(row["metric"], row["iou"])
    plot.update_xaxes(title=f"{label} by the generalist (%)")
    plot.update_yaxes(title=f"{label} by own detectors (%)")
    return plot
