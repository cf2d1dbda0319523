"""Tables of a search's page, as cells of text."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from tracking.labels import DASH, digits, metric_label, not_significant, number, span
from tracking.pages.section import Column, Table, numbers, words
from tracking.run_folders.search_json import Objective, Rig, SearchResult
from tracking.search_report.headline import format_value

_SHARED = ("class", "metric", "seeds")


def mount_table(caption: str, rig: Rig) -> Table:
    """List the mounts of the LiDARs of a rig, metres and degrees."""
    head = ("LiDAR", "model", "zone", "x (m)", "y (m)", "z (m)", "roll (°)", "pitch (°)", "yaw (°)")
    lidars, rows = zip(rig.models, rig.zones, rig.mounts, strict=True), []
    for i, (model, zone, mount) in enumerate(lidars, start=1):
        place = (digits(value, "z.3f") for value in mount[:3])
        angles = (digits(value, "z.2f") for value in np.degrees(mount[3:]))
        rows.append((str(i), model, zone or DASH, *place, *angles))
    return Table(caption, head, tuple(rows), words=frozenset({0, 1, 2}), wide=True)


def rig_table(caption: str, search: SearchResult) -> Table:
    """List values of rigs with all rays, the best feasible one by the first objective on top."""
    rigs, objectives, first = search.rigs, search.objectives, search.first

    def rank(name: str) -> tuple[bool, bool, float]:
        value = -first.sign * rigs[name].value(first)
        return not rigs[name].feasible, bool(np.isnan(value)), value

    head = ("rig", "role", "feasible", "LiDARs", *(objective.label for objective in objectives))
    rows, best, ranked = [], set(), {name: rigs[name] for name in sorted(rigs, key=rank)}
    for name, rig in ranked.items():
        cells = (rig.role, "yes" if rig.feasible else "not feasible", str(len(rig.mounts)))
        rows.append((name, *cells, *(format_value(o, rig.value(o)) for o in objectives)))
    for column, o in enumerate(objectives, start=4):
        values = np.array([o.sign * rig.value(o) for rig in ranked.values() if rig.feasible])
        if np.isfinite(values).any():
            best.add((int(np.nanargmax(values)), column))
    return Table(caption, head, tuple(rows), frozenset(best), words=frozenset({0, 1, 2}))


def greedy_table(greedy: pd.DataFrame, rays: str) -> Table:
    """List the gain and the mount of every LiDAR of greedy choice; `rays` is `strided`."""
    columns = [
        Column(str(name), partial(_cell, name), not is_numeric_dtype(greedy[name]))
        for name in greedy.columns
    ]
    caption = f"Greedy, step by step{f' · as searched, with {rays}' if rays else ''}"
    return Table.of(caption, greedy, columns, wide=True)


def robustness_table(rows: pd.DataFrame) -> Table:
    """Show `robustness.parquet` as text."""
    rows = rows.assign(percent=100 * rows["share"])
    columns = [
        *(words(name) for name in ("rig", "case", "objective")),
        numbers("draws", "draws", ","),
        numbers("mean", "value", number),
        numbers("worst", "worst", number),
        numbers("mean of its own as designed (%)", "percent", ".2f"),
    ]
    return Table.of("Mean and worst over draws", rows, columns, wide=True)


def verified_table(rows: pd.DataFrame, baseline: str, objective: Objective) -> Table:
    """Show `verified.parquet` as text; what all rows share is in the caption."""
    low, high = "difference_low", "difference_high"
    differing = ["difference", low, high]
    rows = rows.copy()
    rows.loc[(rows["rig"] == baseline) | rows["difference"].isna(), differing] = np.nan
    rows["class"] = rows["class"].replace("all", "all objects")
    rows["metric"] = [*map(metric_label, rows["metric"], rows["iou"])]
    rows["seeds"] = [f"{n:,} seed{'s' * (n != 1)}" for n in rows["seeds"]]
    shared = {name: str(rows[name].iloc[0]) for name in _SHARED if rows[name].nunique() == 1}
    columns = [
        *(words(name) for name in ("rig", "role", *_SHARED) if name not in shared),
        numbers(objective.label, "surrogate", lambda value: format_value(objective, value)),
        numbers("value (%)", "value", ".1f"),
        *[Column("95 % CI", lambda row: span(row["low"], row["high"], ".1f"))]
        * bool(rows["low"].notna().any()),
        numbers(f"difference to {baseline}", "difference", "+z.1f"),
        Column(
            "95 % CI",
            lambda row: span(row[low], row[high], "+.1f") + not_significant(row[low], row[high]),
        ),
    ]
    caption = " · ".join(shared.values()) or "Means over seeds"
    return Table.of(caption, rows, columns, wide=True)


def _cell(name: object, row: Mapping[Any, Any]) -> str:
    value = row[name]
    if isinstance(value, str):
        return value
    if value is None or pd.isna(value):
        return DASH
    return digits(value, ".5g") if isinstance(value, float) else str(value)
