"""Comparison of one detector for all rigs with detectors trained for each."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from tracking.findings.generalist import CALIBRATION, JUDGEMENTS, compare, seconds_a_placement
from tracking.findings.groups import EVALUATOR
from tracking.labels import setting_label
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
from tracking.report.sections.ceiling import CEILING
from tracking.run_folders.sweep import RunFolder

_NOTE = (
    "The generalist is one detector, trained on other rigs, that evaluates each placement "
    "without a training for it; its own detectors were trained for the placement. Only the order "
    "decides which placement is best. They met the same test objects, so the ceiling is by the "
    "seeds of the own detectors alone. Bias: the generalist's less their own, mean over "
    "placements. Slope: by how many points their own differ where the generalist's differ by one. "
    "95 % in brackets."
)


def generalist_section(analysis: Analysis) -> Section | None:
    """Compare both kinds of detectors; None unless both judged the same placements."""
    run = analysis.run
    if not analysis.surrogates["surrogate"].isin(JUDGEMENTS).any():
        return None
    rows = compare(run, analysis.means, analysis.correlations)
    if rows.empty:
        return None
    section = Section("Does one detector for all rigs rank them as their own do?", [_NOTE])
    section.tables = [_table(run, rows), _seconds(run)]
    section.notes += _once(run.tasks)
    return section


def _own(run: RunFolder, rows: pd.DataFrame, row: Mapping[Any, Any]) -> str:
    """Name detector, evaluator and setting, as far as there are several."""
    keys = ["detector", *run.axes]
    varying = [key for key in keys if rows[key].nunique(dropna=False) > 1]
    axes = [key for key in varying if key not in ("detector", EVALUATOR)]
    named = [str(row[key]) for key in ("detector", EVALUATOR) if key in varying]
    return ", ".join(filter(None, (*named, setting_label(axes, row))))


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
    ]
    caption = "The generalist against the placements' own detectors"
    data = rows.drop(columns=["surrogate", "pairs_tested", "exact"])
    units = dict.fromkeys(CALIBRATION[:3], "points")
    return Table.of(caption, rows, columns, units, name="generalist", data=data)


def _seconds(run: RunFolder) -> Table:
    columns = [
        words("evaluator", EVALUATOR),
        words("detector"),
        numbers("trials", "trials", ",.0f"),
        numbers("seconds of a placement and seed", "seconds", ",.3g"),
    ]
    caption = "Cost of an evaluation: by the generalist; by own detectors, training included"
    rows = seconds_a_placement(run.trials)
    return Table.of(caption, rows, columns, {"seconds": "s"}, name="generalist-seconds")


def _once(tasks: pd.DataFrame | None) -> list[str]:
    """Say how long the trainings of generalists took, each for all placements."""
    if tasks is None or not (seconds := tasks.loc[tasks["stage"] == "pretrain", "seconds"]).size:
        return []
    many = f"{len(seconds)} trainings of a generalist" if len(seconds) > 1 else "one training"
    return [f"Before its first judgement: {many}, {seconds.sum():,.0f} s together, without clouds."]
