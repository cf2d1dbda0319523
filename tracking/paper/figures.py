"""Figures of a sweep as files for a paper: matplotlib, at the width of a column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from lidarplace.files.atomic import replacing
from lidarplace.viewing.solids import corners
from tracking import labels
from tracking.figures.kit.style import OUTLINE, colour, lidar_colour
from tracking.findings.summary import surrogates_of
from tracking.findings.surrogate_accuracy import relative_errors, summarise, varied
from tracking.kitti_iou import at_headline_iou
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label, headline_label
from tracking.report.sections.ablations import DENSITY, tilt_differences

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = ("pdf", "svg", "png")
COLUMN_INCHES = 3.5
"""Width of a column of a paper in two columns."""
_PAGE_INCHES = 7.2
_STYLE = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 7,
    "lines.markersize": 4,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "text.parse_math": False,  # names may have $
    "svg.hashsalt": "lidarplace",  # a figure is the same file each time
}
_MOST_NAMED = 10  # placements with their names beside the points
_ACROSS = 4  # clouds in a row


def write_figures(analysis: Analysis, folder: Path, kind: str) -> list[Path]:
    """Write the figures that the run has data for as files of a kind in FORMATS; their paths.

    Surrogates against AP or recall, a file for each surrogate; the clouds of one frame; ablations
    of density and tilt; error against run time. A folder holds figures of one run only."""
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, figure in _figures(analysis):
            written.append(folder / f"{name}.{kind}")
            fixed = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}[kind]
            with replacing(written[-1]) as partial:
                figure.savefig(partial, format=kind, dpi=300, metadata=fixed)
    return written


def _figures(analysis: Analysis) -> Iterator[tuple[str, Figure]]:
    for surrogate in labels.in_order(analysis.correlations.get("surrogate", ())):
        if figure := _against_metrics(analysis, surrogate):
            yield f"{surrogate}-against-metrics", figure
    if figure := _clouds(analysis):
        yield "clouds", figure
    if figure := _density(analysis):
        yield "density", figure
    if figure := _tilts(analysis):
        yield "tilts", figure
    if figure := _error_against_time(analysis):
        yield "error-against-run-time", figure


def _panels(count: int, across: int, height: float) -> tuple[Figure, list[Axes]]:
    """Make `count` axes of a height in inches, `across` in a row, in a column or a whole page."""
    from matplotlib.figure import Figure

    rows, width = ceil(count / across), COLUMN_INCHES if across <= 2 else _PAGE_INCHES
    figure = Figure(figsize=(width, rows * height), layout="constrained")
    axes = figure.subplots(rows, across, squeeze=False).ravel()
    for spare in axes[count:]:
        spare.remove()
    return figure, list(axes[:count])


def _against_metrics(analysis: Analysis, surrogate: str) -> Figure | None:
    """Plot the headline metric of each class over a surrogate, in the first group."""
    from matplotlib.ticker import EngFormatter, MaxNLocator

    run, group = analysis.run, analysis.groups[0]
    shown: dict[str, tuple[pd.DataFrame, Mapping[Any, Any]]] = {}
    for name in (*run.classes, "all"):
        values = surrogates_of(analysis.summed_surrogates, group.place, name)
        means = at_headline_iou(group.of(analysis.means), run.results, name)
        tests = at_headline_iou(group.of(analysis.correlations), run.results, name)
        tests = tests[(tests["surrogate"] == surrogate) & tests["spearman"].notna()]
        if len(tests) and surrogate in values:
            points = means.set_index("placement").join(values[surrogate], how="inner")
            shown[name] = points.dropna(subset=["mean", surrogate]), tests.iloc[0].to_dict()
    if not shown:
        return None
    figure, axes = _panels(len(shown), min(len(shown), 2 if len(shown) != 3 else 3), 2.0)
    for axis, (name, (points, row)) in zip(axes, shown.items(), strict=True):
        half = points["half"].fillna(0.0)
        axis.errorbar(points[surrogate], points["mean"], half, fmt="o", color=colour(0), lw=0.8)
        for place, (x, y) in points[[surrogate, "mean"]].iterrows():
            if len(points) <= _MOST_NAMED:
                axis.annotate(str(place), (x, y), (3, 3), textcoords="offset points", fontsize=6)
        interval = labels.interval(row["spearman_low"], row["spearman_high"])
        rho = f"ρ = {labels.signed(row['spearman'])} {interval}"
        axis.set_title(f"{class_label(name)}\n{rho}")
        axis.set(xlabel=labels.surrogate_label(surrogate))
        axis.xaxis.set_major_locator(MaxNLocator(3))
        axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        axis.set(ylabel=f"{headline_label(run.results, name)} (%)")
    return figure


def _clouds(analysis: Analysis) -> Figure | None:
    """Draw the clouds of all placements in one frame from above, a colour for each LiDAR."""
    run, frame = analysis.run, analysis.run.frame
    names = [name for name in analysis.order if frame is not None and name in frame.points]
    if frame is None or not names:
        return None
    figure, axes = _panels(len(names), min(len(names), _ACROSS), 1.6)
    for axis, name in zip(axes, names, strict=True):
        points, lidar = frame.points[name], frame.lidar[name]
        shades = [lidar_colour(number) for number in lidar.tolist()]
        # Dots would be the largest part of a file of vectors.
        axis.scatter(points[:, 0], points[:, 1], s=0.15, c=shades, lw=0, rasterized=True)
        for box in corners(frame.boxes)[:, [3, 2, 0, 1, 3], :2]:
            axis.plot(box[:, 0], box[:, 1], color=OUTLINE, lw=0.6)
        axis.set(xlim=run.roi.x, ylim=run.roi.y, aspect="equal", title=name)
        axis.tick_params(labelsize=6)
        axis.grid(visible=False)
    axes[0].set(xlabel="x (m)", ylabel="y (m)")
    return figure


def _density(analysis: Analysis) -> Figure | None:
    """Plot the headline metric of each class over traffic density, a line for each placement."""
    run = analysis.run
    if DENSITY not in run.axes or run.trials[DENSITY].nunique() < 2:
        return None
    tables = {n: at_headline_iou(analysis.means, run.results, n) for n in (*run.classes, "all")}
    tables = {name: table for name, table in tables.items() if table["seeds"].gt(0).any()}
    figure, axes = _panels(len(tables), min(len(tables), 3), 2.4)
    for axis, (name, table) in zip(axes, tables.items(), strict=True):
        for i, (placement, rows) in enumerate(table.groupby("placement", sort=False)):
            means = rows.groupby(DENSITY)["mean"].mean()
            axis.plot(means.index, means, "o-", color=colour(i), lw=1, label=str(placement))
        metric = f"{headline_label(run.results, name)} (%)"
        axis.set(title=class_label(name), xlabel="density", ylabel=metric)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _tilts(analysis: Analysis) -> Figure | None:
    """Plot what tilting LiDARs adds to the headline metric of the first class, a row a pair."""
    results, name = analysis.run.results, analysis.run.classes[0]
    rows = at_headline_iou(tilt_differences(analysis), results, name)
    if rows.empty:
        return None
    figure, (axis,) = _panels(1, 1, 0.8 + 0.2 * len(rows))
    half = (rows["high"] - rows["difference"]).fillna(0.0)
    axis.errorbar(rows["difference"], range(len(rows)), xerr=half, fmt="o", color=colour(0), lw=0.8)
    axis.axvline(0.0, color=OUTLINE, lw=0.8)
    axis.set_yticks(range(len(rows)), rows["pair"] + ", " + rows["angle"])
    axis.invert_yaxis()
    axis.set(xlabel=f"{headline_label(results, name)} of {name}: points more if tilted")
    return figure


def _error_against_time(analysis: Analysis) -> Figure | None:
    """Plot the error of S-MIG computed faster over its seconds, of the first class."""
    table = analysis.run.accuracy
    if table is None or table.empty:
        return None
    summary = summarise(relative_errors(table))
    name = labels.in_order(summary["surrogate"])[0]
    rows = summary[(summary["surrogate"] == name) & (summary["class"] == summary["class"].iloc[0])]
    figure, (axis,) = _panels(1, 1, 2.4)
    for i, (group, part) in enumerate(rows.groupby(varied(rows), sort=False)):
        drawn = part[part["median_error"] > 0].sort_values("seconds")  # the axis is logarithmic
        axis.loglog(
            drawn["seconds"], drawn["median_error"], "o-", lw=1, color=colour(i), label=str(group)
        )
    error = f"relative error of {labels.surrogate_name(name)}"
    axis.set(xlabel="seconds a placement", ylabel=error)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
