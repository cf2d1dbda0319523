"""Surrogates that were computed faster: error against run time."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from tracking.figures.kit.named_points import label_places
from tracking.figures.kit.style import add_menu, colour, error_bars, figure, legend_below, text
from tracking.findings.groups import by_setting, studied
from tracking.findings.surrogate_accuracy import relative_errors, summarise, varied
from tracking.labels import digits, in_order, signed, surrogate_name
from tracking.pages.section import SURROGATE, Column, Section, Table, numbers, slug
from tracking.report.analysis import Analysis

_STYLES = {
    "bresenham, azimuth steps": (5, "square"),
    "dda, azimuth steps": (0, "circle"),
    "resolution": (2, "diamond"),
    "frames": (1, "triangle-up"),
}
MOST_CHOICES = 4  # sentences on what to choose
FIRST = "s_mig"  # surrogate before another is chosen
_PARTS = 25
"""Points along a line that labels keep off."""
LEAST_SECONDS = 1e-6  # of a logarithmic axis, for what a clock measured as 0


def accuracy_section(analysis: Analysis) -> Section:
    """Show errors and ranks of every cheaper way to compute a surrogate, against its seconds."""
    run = analysis.run
    title = "Surrogates: error against run time"
    if run.accuracy is None or run.accuracy.empty:
        return Section(
            title,
            ["Errors against run time: not computed; surrogate.accuracy of a sweep adds them."],
        )
    section = Section(title, columns=2)
    section.notes.append(
        "Error against the finest resolution that was computed; a coarse grid makes beams thick "
        "and too few rays leave gaps, and the two errors can cancel. The table has the error at "
        "the same resolution, of the method, of fewer azimuth steps and of fewer frames, and "
        "whether the placements are ranked alike. Medians over placements, bars to the largest; "
        "hollow points have no error. The menu chooses the surrogate."
    )
    section.notes += studied(run, run.accuracy)
    choices = []
    for title, part in by_setting(run.accuracy, run.axes):
        summary = summarise(relative_errors(part))
        for name, of_class in summary.groupby("class", sort=False):
            label = f"{name}, {title}" if title else str(name)
            choices.append(f"{label}: {_choice(of_class)}")
            errors = of_class[of_class["median_error"].notna()]  # not of a surrogate that is 0
            if len(errors):
                section.figures.append(accuracy_figure(errors, f"Error against run time · {label}"))
            section.tables.append(accuracy_table(of_class, label))
    section.notes[:0] = choices[:MOST_CHOICES]
    return section


def _choice(summary: pd.DataFrame) -> str:
    """Name the fastest computation of S-MIG that ranks placements as the reference does."""
    name = FIRST if FIRST in set(summary["surrogate"]) else summary["surrogate"].iloc[0]
    rows = summary[summary["surrogate"] == name].sort_values("seconds")
    reference = rows[rows["reference"]].iloc[0]
    faster = rows[rows["seconds"] < reference["seconds"]]
    alike = faster[faster["kendall"] > 1 - 1e-9]
    as_fine = f"{reference['resolution']:g} m ({reference['seconds']:.2g} s)"
    if len(alike):
        return f"choose {_cost(alike.iloc[0], reference)}, ranks as at {as_fine}."
    if np.isfinite(reference["kendall"]):
        return f"no faster {surrogate_name(name)} ranks the placements as at {as_fine}."
    why = f"too few different values of {surrogate_name(name)} for a ranking"
    if faster["median_error"].isna().all():
        return f"{why}."
    closest = faster.loc[faster["median_error"].idxmin()]
    return f"{_cost(closest, reference)} against {as_fine}, the least of the faster ones; {why}."


def _cost(row: pd.Series, reference: pd.Series) -> str:
    """Say how a surrogate was computed, its seconds and its error."""
    rays = f", {row['azimuth_steps']:,} azimuth steps" if row["azimuth_steps"] else ""
    frames = f", {row['frames']:,} frames" if row["frames"] < reference["frames"] else ""
    computation = f"{row['resolution']:g} m, {row['method']}{rays}{frames}"
    error = f"error {_percent(row['median_error'])} %"
    return f"{computation}: {row['seconds']:.2g} s a placement, {error}"


def accuracy_table(summary: pd.DataFrame, title: str) -> Table:
    """Show `tracking.findings.surrogate_accuracy.summarise` of one class as text."""
    columns = [
        SURROGATE,
        Column(
            "method",
            lambda row: str(row["method"]) + (" (reference)" if row["reference"] else ""),
            words=True,
        ),
        numbers("resolution (m)", "resolution", "g"),
        Column(
            "azimuth steps",
            lambda row: f"{row['azimuth_steps']:,}" if row["azimuth_steps"] else "all",
        ),
        numbers("frames", "frames", ","),
        numbers("error (%)", "median_error", _percent),
        numbers("worst (%)", "worst_error", _percent),
        numbers("same resolution (%)", "median_method_error", _percent),
        numbers("Spearman ρ", "spearman", signed),
        numbers("Kendall τ", "kendall", signed),
        numbers("seconds", "seconds", ".3g"),
        numbers("POG seconds", "pog_seconds", ".3g"),
    ]
    return Table.of(
        f"Rank agreement with the reference and errors · {title}",
        summary,
        columns,
        wide=True,
        name=slug("surrogate accuracy", title),
        units={"resolution": "m", "seconds": "s", "pog_seconds": "s"},
    )


def _percent(error: float) -> str:
    return digits(100 * error, ".3g")


def accuracy_figure(summary: pd.DataFrame, title: str) -> go.Figure:
    """Draw the error against the fine reference over seconds; a menu chooses the surrogate.

    `summary` is `summarise` of one class and one setting."""
    plot = figure(text(title), height=440, margin={"t": 104})
    names = in_order(summary["surrogate"])
    first = FIRST if FIRST in names else names[0]
    drawn = []
    for name in names:
        part = summary[summary["surrogate"] == name]
        positive = part.loc[part["median_error"] > 0, "median_error"]
        # An error of 0 has no place on a logarithmic axis: its hollow point is below all others.
        floor = 10 ** np.floor(np.log10(positive.min()) - 0.5) if len(positive) else 1e-16
        lines = [_line(rows, str(g), floor) for g, rows in part.groupby(varied(part), sort=False)]
        _place_labels(lines)
        for line in lines:
            plot.add_trace(line.update(visible=name == first))
            drawn.append(name)
    labels = [surrogate_name(name) for name in names]
    changes = [({"visible": [name == surrogate for surrogate in drawn]},) for name in names]
    add_menu(plot, labels, changes, names.index(first), right=True, y=1.04)
    powers = {"type": "log", "exponentformat": "power", "dtick": 1}
    plot.update_xaxes(title="seconds a placement and class", **powers)
    plot.update_yaxes(title="relative error", **powers)
    return legend_below(plot)


def _place_labels(lines: Sequence[go.Scatter]) -> None:
    """Place labels so that they cover few points, lines and bars; both axes are logarithmic."""
    points = [np.log10([line.x, line.y]).T for line in lines]
    tops = [np.log10([line.x, line.y + line.error_y.array]).T for line in lines]
    covered = [_along(at[:-1], at[1:]) for at in points]
    covered += [_along(at, top) for at, top in zip(points, tops, strict=True)]
    x, y = np.concatenate(points + covered).T
    labels = [label for line in lines for label in line.text]
    places = iter(label_places(x, y, labels + [""] * (len(x) - len(labels))))
    for line in lines:
        line.textposition = [next(places) for _ in line.text]


def _along(starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points along segments from each start to its end, both of shape (n, 2)."""
    share = np.linspace(0.0, 1.0, _PARTS)[:, None, None]
    return np.asarray((1 - share) * starts + share * ends).reshape(-1, 2)


def _line(rows: pd.DataFrame, group: str, floor: float) -> go.Scatter:
    rows = rows.sort_values("seconds")
    value, worst = (rows[key].clip(lower=floor) for key in ("median_error", "worst_error"))
    seconds = rows["seconds"].clip(lower=LEAST_SECONDS)
    shade, shape = _STYLES.get(group) or _STYLES[group.rsplit(", ", 1)[1]]
    labels = [f"{n:,}" for n in rows["azimuth_steps"]]
    if group.endswith("resolution"):
        labels = [f"{r:g} m" for r in rows["resolution"]]
    elif group.endswith("frames"):
        labels = [f"{n:,} frames" for n in rows["frames"]]
    hollow = rows["median_error"] == 0
    return go.Scatter(
        x=seconds.to_numpy(),
        y=value.to_numpy(),
        error_y=error_bars(worst - value, np.zeros(len(rows)), thickness=1),
        mode="lines+markers+text",
        line={"color": colour(shade), "width": 1.5},
        marker={"size": 8, "symbol": [f"{shape}-open" if zero else shape for zero in hollow]},
        text=labels,
        textfont={"size": 10, "color": colour(shade)},
        cliponaxis=False,
        customdata=rows[["median_error", "kendall"]].to_numpy(),
        hovertemplate="%{text}<br>%{x:.3g} s<br>error %{customdata[0]:.3g}, τ %{customdata[1]:.2f}",
        name=group,
        showlegend=True,
    )
