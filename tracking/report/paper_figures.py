"""Figures of a sweep as files for a paper: matplotlib, at the width of a column."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from html import unescape
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from lidarplace.files.atomic import replacing
from lidarplace.logs.boxes import corners
from tracking import labels
from tracking.figures.kit.style import DIVERGING, OUTLINE, colour, lidar_colour
from tracking.findings.groups import at
from tracking.findings.summary import surrogates_of
from tracking.findings.surrogate_accuracy import relative_errors, summarise, varied
from tracking.kitti_iou import at_headline_iou
from tracking.pages.section import slug
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label, headline_label
from tracking.report.sections.ablations import DENSITY, tilt_differences
from tracking.report.sections.accuracy import LEAST_SECONDS
from tracking.report.sections.best import MOST_DRAWN
from tracking.report.sections.coefficient_map import coefficient_cells, coefficient_charts

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
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "lines.markersize": 4,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "text.parse_math": False,  # names may have $
    "svg.hashsalt": "lidarplace",  # a figure is the same file each time
}
_MOST_NAMED = 16  # placements in the legend of points
_MARKERS = "oDs^XPv*"
_ACROSS = 4  # clouds in a row
_Maker = tuple[str, str, Callable[[], "Figure | None"]]
_File = tuple[str, Path]


def write_figures(analysis: Analysis, folder: Path, kind: str) -> list[Path]:
    """Write the figures that the run has data for as files of a kind in FORMATS; their paths.

    Correlations of surrogates with AP and recall; these against each surrogate; placements with
    intervals; the clouds of one frame; ablations of density and tilt; error against run time."""
    makers = _makers(analysis, _surrogates(analysis))
    return [path for _, path in _write(makers, folder, kind, dpi=300)]


def write_pictures(analysis: Analysis, folder: Path, sections: Collection[str]) -> list[_File]:
    """Write small PNGs of figures of the report's `sections`, with the section that each is of."""
    makers = _makers(analysis, _surrogates(analysis)[:1])
    return _write([maker for maker in makers if maker[0] in sections], folder, "png", dpi=150)


def _surrogates(analysis: Analysis) -> list[str]:
    return labels.in_order(analysis.correlations.get("surrogate", ()))


def _makers(analysis: Analysis, surrogates: Sequence[str]) -> Iterator[_Maker]:
    """Yield for each figure its section, its title and how to make it."""
    yield "coefficient_map", "correlations", partial(_correlations, analysis)
    for name in surrogates:
        yield "coefficient_map", f"{name} against metrics", partial(_scatter, analysis, name)
    yield "best", "placements", partial(_placements, analysis)
    yield "accuracy", "error against run time", partial(_error_against_time, analysis)
    yield "tilts", "tilts", partial(_tilts, analysis)
    yield "density", "density", partial(_density, analysis)
    yield "clouds", "clouds", partial(_clouds, analysis)


def _write(makers: Iterable[_Maker], folder: Path, kind: str, dpi: int) -> list[_File]:
    """Write the figures that have data."""
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    fixed = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}[kind]
    written, count = [], Counter[str]()
    with matplotlib.rc_context(_STYLE):
        for section, title, make in makers:
            if (figure := make()) is None:
                continue
            name = slug(title)
            count[name] += 1
            path = folder / f"{name}{f'-{count[name]}' * (count[name] > 1)}.{kind}"
            with replacing(path) as incomplete:
                figure.savefig(incomplete, format=kind, dpi=dpi, metadata=fixed)
            written.append((section, path))
    return written


def _panels(count: int, across: int, height: float) -> tuple[Figure, list[Axes]]:
    """Make `count` axes of a height in inches, `across` in a row, in a column or a whole page."""
    from matplotlib.figure import Figure

    rows, width = ceil(count / across), COLUMN_INCHES if across <= 2 else _PAGE_INCHES
    figure = Figure(figsize=(width, rows * height), layout="constrained")
    axes = figure.subplots(rows, across, squeeze=False).ravel()
    for spare in axes[count:]:
        spare.remove()
    return figure, list(axes[:count])


def _correlations(analysis: Analysis) -> Figure | None:
    """Draw ρ of surrogates, a row each, with the headline metrics of the first group."""
    from matplotlib.colors import LinearSegmentedColormap

    if not analysis.predictors:
        return None
    _, chart = next(coefficient_charts(analysis))
    chart = chart[chart["spearman"].notna()]
    if chart.empty:
        return None
    rows = labels.in_order(chart["surrogate"])
    cells = coefficient_cells(chart, rows)
    figure, (axis,) = _panels(1, 1, 0.6 + 0.17 * len(rows))
    shades = LinearSegmentedColormap.from_list("", DIVERGING)
    axis.imshow(cells["z"], shades, vmin=-1, vmax=1, aspect="auto")
    for (i, j), rho in np.ndenumerate(cells["text"]):
        bold = "bold" if rho.startswith("<b>") else "normal"
        rho = rho.removeprefix("<b>").removesuffix("</b>")
        axis.text(j, i, rho, ha="center", va="center", fontsize=7, weight=bold)
    columns = [unescape(name.replace("<br>", "\n")) for name in cells["x"]]
    axis.set_xticks(range(len(columns)), columns, fontsize=7)
    axis.set_yticks(range(len(rows)), map(labels.surrogate_short, rows))
    axis.tick_params(length=0)
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)
    return figure


def _placements(analysis: Analysis) -> Figure | None:
    """Plot what decides in the first group, and AP of the first class, a row a placement."""
    if not analysis.recommended:
        return None
    run, recommended = analysis.run, analysis.recommended[0]
    names = [n for n in dict.fromkeys((recommended.by, *run.classes)) if n in recommended.ranking]
    rows = recommended.best.sure.index[:MOST_DRAWN].tolist()
    figure, axes = _panels(len(names[:2]), len(names[:2]), 0.7 + 0.17 * len(rows))
    for axis, name in zip(axes, names, strict=False):
        means = at_headline_iou(recommended.group.of(analysis.means), run.results, name)
        means = means.set_index("placement").reindex(rows)
        half = means["half"].fillna(0.0)
        axis.errorbar(means["mean"], range(len(rows)), xerr=half, fmt="o", color=colour(0), lw=0.8)
        axis.set_yticks(range(len(rows)), rows if axis is axes[0] else [])
        axis.invert_yaxis()
        metric = f"{headline_label(run.results, name)} (%)"
        axis.set(title=class_label(name), xlabel=metric)
    return figure


def _scatter(analysis: Analysis, surrogate: str) -> Figure | None:
    """Plot the headline metric of each class over a surrogate, in the first group."""
    from matplotlib.ticker import EngFormatter, MaxNLocator

    run, group = analysis.run, analysis.groups[0]
    panels: dict[str, tuple[pd.DataFrame, Mapping[Any, Any]]] = {}
    for name in (*run.classes, "all"):
        values = surrogates_of(analysis.summed_surrogates, group.place, name)
        means = at_headline_iou(group.of(analysis.means), run.results, name)
        tests = at_headline_iou(group.of(analysis.correlations), run.results, name)
        tests = tests[(tests["surrogate"] == surrogate) & tests["spearman"].notna()]
        if len(tests) and surrogate in values:
            points = means.set_index("placement").join(values[surrogate], how="inner")
            panels[name] = points.dropna(subset=["mean", surrogate]), tests.iloc[0].to_dict()
    if not panels:
        return None
    figure, axes = _panels(len(panels), min(len(panels), 2 if len(panels) != 3 else 3), 2.0)
    for axis, (name, (points, row)) in zip(axes, panels.items(), strict=True):
        for i, placement in enumerate(run.placements):
            part = points[points.index == placement]
            if len(part):
                half, shape = part["half"].fillna(0.0), _MARKERS[i % len(_MARKERS)]
                bars = axis.errorbar(
                    part[surrogate], part["mean"], half, fmt=shape, color=colour(i), lw=0.8
                )
                bars.set_label(placement)
        interval = labels.interval(row["spearman_low"], row["spearman_high"])
        rho = f"ρ = {labels.signed(row['spearman'])} {interval}"
        axis.set_title(f"{class_label(name)}\n{rho}")
        axis.set(xlabel=labels.surrogate_label(surrogate))
        axis.xaxis.set_major_locator(MaxNLocator(3))
        axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        axis.set(ylabel=f"{headline_label(run.results, name)} (%)")
    if len(axes[0].containers) <= _MOST_NAMED:
        _add_legend(figure, axes[0].containers)
    return figure


def _add_legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Name the parts of a figure below it, also those whose names begin with "_"."""
    names = [str(handle.get_label()) for handle in handles]
    across = 2 if figure.get_figwidth() == COLUMN_INCHES and max(map(len, names)) > 12 else 3
    figure.legend(handles, names, loc="outside lower center", ncols=across, frameon=False)


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
        axis.scatter(points[:, 0], points[:, 1], s=0.4, c=shades, lw=0, rasterized=True)
        for box in corners(frame.boxes)[:, [3, 2, 0, 1, 3], :2]:
            axis.plot(box[:, 0], box[:, 1], color=OUTLINE, lw=0.6)
        axis.set(xlim=run.roi.x, ylim=run.roi.y, aspect="equal", title=name)
        axis.tick_params(labelsize=6)
        axis.grid(visible=False)
    axes[0].set(xlabel="x (m)", ylabel="y (m)")
    return figure


def _density(analysis: Analysis) -> Figure | None:
    """Plot the headline metric of each class over traffic density, in the first other setting."""
    run = analysis.run
    if DENSITY not in run.axes or run.trials[DENSITY].nunique() < 2:
        return None
    place = {axis: v for axis, v in analysis.groups[0].place.items() if axis != DENSITY}
    means = at(analysis.means, place)
    tables = {n: at_headline_iou(means, run.results, n) for n in (*run.classes, "all")}
    tables = {name: table for name, table in tables.items() if table["seeds"].gt(0).any()}
    if not tables:
        return None
    figure, axes = _panels(len(tables), min(len(tables), 3), 2.4)
    for axis, (name, table) in zip(axes, tables.items(), strict=True):
        for i, (placement, rows) in enumerate(table.groupby("placement", sort=False)):
            rows = rows.sort_values(DENSITY)
            axis.plot(rows[DENSITY], rows["mean"], "o-", color=colour(i), lw=1, label=placement)
        metric = f"{headline_label(run.results, name)} (%)"
        axis.set(title=class_label(name), xlabel="density", ylabel=metric)
    _add_legend(figure, axes[0].lines)
    return figure


def _tilts(analysis: Analysis) -> Figure | None:
    """Plot what tilting LiDARs adds to AP of the first class in the first group, a row a pair."""
    results, name = analysis.run.results, analysis.run.classes[0]
    rows = at_headline_iou(tilt_differences(analysis), results, name)
    rows = rows[rows["detector"] == analysis.groups[0].title]
    if rows.empty:
        return None
    figure, (axis,) = _panels(1, 1, 0.8 + 0.2 * len(rows))
    half = (rows["high"] - rows["difference"]).fillna(0.0)
    axis.errorbar(rows["difference"], range(len(rows)), xerr=half, fmt="o", color=colour(0), lw=0.8)
    axis.axvline(0.0, color=OUTLINE, lw=0.8)
    axis.set_yticks(range(len(rows)), rows["pair"] + ", " + rows["angle"])
    axis.margins(y=0.2)
    axis.invert_yaxis()
    axis.set(xlabel=f"points of {headline_label(results, name)}\nmore if tilted, {name}")
    return figure


def _error_against_time(analysis: Analysis) -> Figure | None:
    """Plot the error of S-MIG computed faster over its seconds, of the first class."""
    from matplotlib.ticker import LogLocator, NullFormatter

    table = analysis.run.accuracy
    if table is None or table.empty:
        return None
    summary = summarise(relative_errors(table))
    name = labels.in_order(summary["surrogate"])[0]
    rows = summary[(summary["surrogate"] == name) & (summary["class"] == summary["class"].iloc[0])]
    figure, (axis,) = _panels(1, 1, 2.4)
    for i, (group, part) in enumerate(rows.groupby(varied(rows), sort=False)):
        part = part[part["median_error"] > 0].sort_values("seconds")  # the axis is logarithmic
        if part.empty:
            continue
        seconds = part["seconds"].clip(lower=LEAST_SECONDS)
        axis.loglog(seconds, part["median_error"], "o-", lw=1, color=colour(i), label=str(group))
    error = f"relative error of {labels.surrogate_name(name)}"
    axis.set(xlabel="seconds a placement", ylabel=error)
    if not axis.lines:
        return None
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        scale.set_major_formatter("{x:g}")
        scale.set_minor_formatter(NullFormatter())
    _add_legend(figure, axis.lines)
    return figure
