"""Section of a page: detection curves with the share of objects that were found."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from scipy import stats

from lidarplace.recall.detection_curve import DetectionCurve
from tracking.figures.kit.style import colour, error_bars, figure, legend_below, symbol, text
from tracking.pages.section import Section
from tracking.statistics.bounded_mean import with_one_at_each_bound

BINS = 12
"""Most bins of objects that are hit; each has about as many, those that are not have their own."""
_NOTHING = 0.4  # place of "0" on a logarithmic axis


def curves_section(curves: Sequence[DetectionCurve], seen: pd.DataFrame) -> Section:
    """Draw detection against cells and against points for every class; `seen`: `observations`."""
    figures = []
    for name in dict.fromkeys(curve.object_class for curve in curves):
        of_class = [curve for curve in curves if curve.object_class == name]
        figures += [_figure(of_class, seen[seen["class"] == name], unit) for unit in _UNITS]
    note = (
        "Markers: share of objects found, with 95 % intervals over individuals; each marker has "
        "about as many objects. Lines: the curve; against points, its mean over the objects of a "
        "marker."
    )
    return Section("Detection curves", [note], figures, columns=2)


_ENDS = ("high", "low")
_UNITS = {"cells": "cells of the surface hit", "points": "points on the object"}


def _figure(curves: Sequence[DetectionCurve], seen: pd.DataFrame, unit: str) -> go.Figure:
    title = f"{text(curves[0].object_class)}: detection against {unit}"
    plot, most = figure(title, height=330), max(seen[unit].max(), 10.0)
    for number, curve in enumerate(curves):
        bins = bins_of(seen[seen["iou"] == curve.iou], unit, curve)
        x = bins[unit].where(bins[unit] > 0, _NOTHING)
        label, shade = f"IoU {curve.iou:g}", colour(number)
        counts = zip(bins["objects"], bins["individuals"], strict=True)
        plot.add_scatter(
            x=x,
            y=100 * bins["found"],
            error_y=error_bars(*(100 * (bins[end] - bins["found"]).abs() for end in _ENDS)),
            mode="markers",
            marker={"color": shade, "symbol": symbol(number), "size": 8},
            name=f"{label}, found",
            customdata=[f"{rows:,} objects, {single:,} individuals" for rows, single in counts],
            hovertemplate=f"%{{x:.3g}} {unit}: %{{y:.1f}} % found, %{{customdata}}<extra></extra>",
        )
        grid = np.geomspace(1, most, 60)
        line = (grid, curve.probability(grid)) if unit == "cells" else (x, bins["expected"])
        plot.add_scatter(
            x=line[0],
            y=100 * line[1],
            mode="lines",
            line={"color": shade},
            name=f"{label}, curve",
            hovertemplate=f"%{{x:.3g}} {unit}: %{{y:.1f}} % by the curve<extra></extra>",
        )
    powers = [10.0**n for n in range(int(np.log10(most)) + 1)]
    ends = [np.log10(_NOTHING) - 0.1, np.log10(most) + 0.1]
    plot.update_xaxes(type="log", title=_UNITS[unit], range=ends, tickvals=[_NOTHING, *powers])
    plot.update_xaxes(ticktext=["0", *(f"{power:,.0f}" for power in powers)])
    plot.update_yaxes(title="share found", ticksuffix=" %", range=[-3, 103])
    return legend_below(plot)


def bins_of(seen: pd.DataFrame, unit: str, curve: DetectionCurve) -> pd.DataFrame:
    """Average the objects of one class and overlap by what was hit of them, fewest first.

    Columns: the unit, `found`, `expected` by the curve, `low` and `high` of its 95 % interval over
    individuals (NaN for a single one), `objects` and `individuals`."""
    values = seen[unit].to_numpy(np.float64)
    hit = values[values > 0]
    shares = np.linspace(0, 1, BINS + 1)[1:-1]
    edges = np.unique(np.quantile(hit, shares, method="inverted_cdf")) if len(hit) else hit
    number = np.where(values > 0, 1 + np.searchsorted(edges, values, side="right"), 0)
    expected = curve.probability(seen["cells"])
    rows = [_bin(part, unit) for _, part in seen.assign(expected=expected).groupby(number)]
    return pd.DataFrame(rows)


def _bin(objects: pd.DataFrame, unit: str) -> dict[str, float]:
    mean, individuals = objects["found"].mean(), objects.groupby(["scene", "object_id"])["found"]
    counts = np.asarray(individuals.count(), np.float64)
    deviations = np.asarray(individuals.sum(), np.float64) - mean * counts
    single, whole = len(counts), counts.sum()
    variance = (deviations**2).sum() / whole**2 * single / max(single - 1, 1)
    effective = whole**2 / (counts**2).sum()
    centre, variance = with_one_at_each_bound(mean, variance, effective, 0.0, 1.0)
    half = stats.t.ppf(0.975, single - 1) * np.sqrt(variance) if single > 1 else np.nan
    return {
        unit: objects[unit].mean(),
        "found": mean,
        "expected": objects["expected"].mean(),
        "low": np.clip(centre - half, 0.0, mean),
        "high": np.clip(centre + half, mean, 1.0),
        "objects": len(objects),
        "individuals": single,
    }
