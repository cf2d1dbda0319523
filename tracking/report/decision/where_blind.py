"""Recall by direction and distance: where each rig sees, and where it is blind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.colors import get_colorscale, hex_to_rgb

from tracking.figures.kit.style import SEQUENTIAL, figure, text
from tracking.labels import digits, metric_label
from tracking.pages.section import Section
from tracking.report.recommendation import Recommendation
from tracking.report.sections.objects import (
    RING,
    SECTOR,
    Bins,
    in_rings,
    in_sectors,
    means_by_bin,
    wide,
)

_METRICS = ("class_recall_3D", "recall", "AP_R40_3D")
"""Metrics by preference: the first that a table has is shown; older run folders have AP alone."""
_FEW = 100  # objects in a bin, below which nothing is said of it
_ROW = 24  # pixels
_PALE = [
    [at, "rgb({:.0f}, {:.0f}, {:.0f})".format(*(0.35 * np.array(hex_to_rgb(shade)) + 0.65 * 255))]
    for at, shade in get_colorscale(SEQUENTIAL)
]


@dataclass(frozen=True)
class _Binned:
    """Metric of one class by direction or distance.

    `values` have placements as rows and bins as columns, percent; `objects` are the number of
    objects by bin."""

    object_class: str
    metric: str
    bins: Bins
    values: pd.DataFrame
    objects: pd.Series

    @property
    def sure(self) -> list[str]:
        """Bins with enough objects to compare rigs by."""
        return [name for name in self.bins.names if self.objects[name] >= _FEW]


def where_blind_section(recommended: Recommendation) -> Section | None:
    """Show recall by direction and by distance, a figure for each class; None without either."""
    run, tables = recommended.run, []
    for table, keys, in_bins in ((run.sector, SECTOR, in_sectors), (run.distance, RING, in_rings)):
        metrics = () if table is None else set(table.get("metric", ()))
        if table is None or not (
            metric := next((name for name in _METRICS if name in metrics), "")
        ):
            continue
        for _, rows in means_by_bin(run, [recommended.group], table, keys, metric):
            tables.append(_binned(recommended.drawn, *in_bins(rows)))
    if not tables:
        return None
    note = (
        "Percent of the objects found; dark is few. n is the number of objects. Cells of fewer "
        f"than {_FEW} objects are pale and in brackets: too few to compare rigs."
    )
    section = Section("Where they see, and where they are blind", [note], columns=2)
    for name in dict.fromkeys(one.object_class for one in tables):
        of_class = [one for one in tables if one.object_class == name]
        limits = _limits(of_class)
        section.figures += [bin_table(one, limits) for one in of_class]
        section.notes += _behind(of_class, recommended.best.best)
    return section


def _limits(tables: list[_Binned]) -> tuple[float, float]:
    """Find the lowest and the highest percentage of any cell; none is beyond the colours."""
    values = np.concatenate([table.values.to_numpy(np.float64).ravel() for table in tables])
    return float(np.nanmin(values)), float(np.nanmax(values))


def _binned(rigs: Sequence[str], rows: pd.DataFrame, bins: Bins) -> _Binned:
    values = wide(rows, bins, "mean")
    first = rows.iloc[0]
    return _Binned(
        str(first["class"]),
        metric_label(first["metric"], first["iou"]),
        bins,
        values.reindex([name for name in rigs if name in values.index]),
        rows.groupby("bin")["ground_truths"].max(),
    )


def _behind(tables: list[_Binned], best: str) -> list[str]:
    """Say where the recommended rig is furthest behind another drawn one: [] or a sentence."""
    leads: list[tuple[float, str, str]] = []
    for table in tables:
        for name, column in table.values[table.sure].items():
            if pd.notna(column.get(best)):
                lead = float(column.max() - column[best])
                leads.append((lead, f"{name}{table.bins.unit}", str(column.idxmax())))
    if not leads:
        return []
    lead, where, other = max(leads)
    cells = f"{tables[0].object_class}: where there are {_FEW} objects or more,"
    if not lead > 0:
        return [f"{cells} {best} is not behind any of these rigs."]
    return [f"{cells} {best} is furthest behind at {where}: {lead:.1f} points below {other}."]


def bin_table(binned: _Binned, limits: tuple[float, float]) -> go.Figure:
    """Draw cells with their numbers, dark where little is found, pale where there are few objects.

    Placements are rows from top to bottom; `limits` are of the darkest and the brightest colour."""
    bins, numbers = binned.bins, list(range(len(binned.bins.names)))
    cells = binned.values.reindex(columns=bins.names)
    small = f"<span style='font-size:12px'>{binned.metric}, %</span>"
    by = bins.of.replace(" of the object", "")
    title = f"{text(binned.object_class)} by {by}<br>{small}"
    margin = {"l": 8, "r": 8, "t": 48, "b": 44}
    plot = figure(title, height=92 + _ROW * len(cells), margin=margin)
    judged = cells.columns.isin(binned.sure)
    for columns, scale, form in ((judged, SEQUENTIAL, "{}"), (~judged, _PALE, "({})")):
        values = cells.loc[:, columns].reindex(columns=bins.names).to_numpy(np.float64)
        labels = [
            [
                form.format(digits(v, ".0f")) if ok else ""
                for v, ok in zip(row, columns, strict=True)
            ]
            for row in values
        ]
        plot.add_heatmap(
            z=values,
            x=numbers,
            y=[text(name) for name in cells.index],
            zmin=limits[0],
            zmax=limits[1],
            colorscale=scale,
            showscale=False,
            text=labels,
            texttemplate="%{text}",
            customdata=np.tile(np.asarray(bins.names, object), (len(cells), 1)),
            hovertemplate=f"%{{y}}, %{{customdata}}{bins.unit}: %{{z:.1f}} %<extra></extra>",
            hoverongaps=False,
            xgap=2,
            ygap=2,
        )
    counts = zip(bins.names, binned.objects[list(bins.names)], strict=True)
    plot.update_xaxes(
        tickvals=numbers,
        ticktext=[f"{name.replace(' ', '<br>')}<br>n {n:,}" for name, n in counts],
        tickfont={"size": 11},
        tickangle=0,
        showgrid=False,
        ticks="",
    )
    return plot.update_yaxes(autorange="reversed", showgrid=False, ticks="")
