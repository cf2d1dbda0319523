"""Colours, templates and small helpers that all figures share."""

import html
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from lidarplace.viewing.style import COLOURS as OKABE_ITO
from lidarplace.viewing.style import OUTLINE as OUTLINE
from lidarplace.viewing.style import theme as theme_of_scenes

COLOURS = (*OKABE_ITO[:-1], "#6040F0")
"""Okabe and Ito's colours, with violet for their yellow, which is lost as a thin line on white."""
_OF_LIDARS = (0, 1, 2, 4, 5, 7, 3, 6)
SYMBOLS = (
    *("circle", "diamond", "square", "triangle-up", "x", "cross", "star", "triangle-down"),
    "pentagon",
)
SEQUENTIAL = "Cividis"
DIVERGING = ((0.0, "#56B4E9"), (0.5, "#f7f7f7"), (1.0, "#E69F00"))
"""Colours of less, blue, and of more, orange."""


def colour(index: int) -> str:
    """Return the colour of the `index`-th of several things; repeats after eight."""
    return COLOURS[index % len(COLOURS)]


def lidar_colour(index: int) -> str:
    """Return the colour of the `index`-th LiDAR of a rig.

    Points are too small for markers: green and pink, one grey to those who do not see red or
    green, are not both among the first four."""
    return colour(_OF_LIDARS[index % len(COLOURS)])


def lidar_markers(count: int, size: float) -> dict[str, Any]:
    """Make diamonds of the LiDARs of a rig."""
    shades, edge = [lidar_colour(i) for i in range(count)], {"color": "#ffffff", "width": 1}
    return {"symbol": "diamond", "size": size, "color": shades, "line": edge}


def symbol(index: int) -> str:
    """Return the marker of the `index`-th of several things: not everybody distinguishes colours.

    There is one more than colours, so that the pair of both repeats after 72 things only."""
    return SYMBOLS[index % len(SYMBOLS)]


def text(value: object) -> str:
    """Escape a user's text: plotly reads tags in titles and labels."""
    return html.escape(str(value), quote=False)


SOFT_BREAK = "<br />"
"""Tag where a title continues in another line, for plotly; a `<br>` ends what the line says."""
_LONGEST_LINE = 50
"""Letters of a title's line that a figure on a phone, or one of three in a row, has room for."""
_LINE = 18  # pixels
_LONGEST_OF_TWO = 10
"""Letters of a name that fits a phone's row of the legend with another one.

A row is as wide as the plot without its labels."""
_SIDE = 16  # pixels on the right of a figure with nothing there

_TITLE = {"x": 0, "xref": "container", "y": 1, "yref": "container", "yanchor": "top"}
_AROUND_TITLE = {"font": {"size": 14}, "pad": {"t": 12, "l": 4}}
QUIET = {"hoverinfo": "skip", "showlegend": False}
"""Attributes of a trace that a pointer and the legend pass over."""
TOLD = {"hoverinfo": "text", "showlegend": False}
"""Attributes of a trace whose points have a text of their own."""


def broken(title: str) -> str:
    """Break the first line of `title` where it is too long."""
    first, *rest = title.split("<br>")
    lines = textwrap.wrap(first, _LONGEST_LINE, break_long_words=False, break_on_hyphens=False)
    return "<br>".join([SOFT_BREAK.join(lines), *rest])


def figure(
    title: str, height: int, margin: dict[str, int] | None = None, **layout: Any
) -> go.Figure:
    """Make an empty figure as wide as its container.

    `title` may hold tags, names go in by `text`. A title that is too long is broken; height and
    top margin then grow."""
    lines = broken(title)
    more = _LINE * lines.count(SOFT_BREAK)
    sides = {"l": 56, "r": _SIDE, "t": 48, "b": 48} | (margin or {})
    return go.Figure(
        layout={
            "title": {"text": lines, **_TITLE, **_AROUND_TITLE},
            "height": height + more,
            "margin": sides | {"t": sides["t"] + more},
            "dragmode": False,
            "template": None,
            **layout,
        }
    )


def legend_below(plot: go.Figure) -> go.Figure:
    """Put the legend right under the axis' title; the figure grows by its height on a phone.

    There two short names fit a row, or a long one."""
    listed = [t for t in plot.data if t.showlegend is not False and t.visible is not False]
    names = [html.unescape(trace.name or "") for trace in listed]
    short = max(map(len, names), default=0) <= _LONGEST_OF_TWO
    # Words next to the figure take their width from its legend, too; groups are not in a row.
    grouped = any(trace.legendgroup for trace in listed)
    in_a_row = 2 if short and not grouped and plot.layout.margin.r <= _SIDE else 1
    room = 20 * -(-len(names) // in_a_row)
    title = _LINE * (plot.layout.xaxis.title.text or "").count("<br>")
    height = plot.layout.height + room + title
    legend = {"orientation": "h", "font": {"size": 11}, "tracegroupgap": 0, "maxheight": 1}
    legend |= {"x": 0, "xref": "container", "y": (room + 8) / height, "yref": "container"}
    margin = {"b": 56 + room + title}
    return plot.update_layout(height=height, margin=margin, legend={**legend, "yanchor": "top"})


def add_menu(
    plot: go.Figure,
    labels: Sequence[str],
    changes: Sequence[Sequence[dict[str, Any]]],
    active: int = 0,
    right: bool = False,
    **place: Any,
) -> go.Figure:
    """Add a menu above the figure, or its right end.

    `labels` are its entries, plotly text; `changes` what each makes of the data, and of the
    layout if there is a second change; `place` has further keys of `updatemenus`."""
    side = {"x": 1, "xanchor": "right"} if right else {"x": 0, "xanchor": "left"}
    buttons = [
        {"label": label, "method": "restyle" if len(change) == 1 else "update", "args": [*change]}
        for label, change in zip(labels, changes, strict=True)
    ]
    whole = {**side, "yanchor": "bottom", "active": active, "buttons": buttons, **place}
    return plot.update_layout(updatemenus=[whole])


def name_rows(plot: go.Figure, names: Sequence[object]) -> None:
    """Name the rows 0, 1, … of a figure from the top."""
    labels, rows = [text(name) for name in names], list(range(len(names)))
    plot.update_yaxes(tickvals=rows, ticktext=labels, range=[len(names) - 0.5, -0.5])


def error_bars(up: ArrayLike, down: ArrayLike | None = None, **style: Any) -> dict[str, Any]:
    """Make error bars, as far down as up unless `down` is given; NaN for none."""
    drawn: dict[str, Any] = {"type": "data", "array": np.asarray(up, np.float64), **style}
    if down is not None:
        drawn |= {"symmetric": False, "arrayminus": np.asarray(down, np.float64)}
    return drawn


def theme(dark: bool) -> dict[str, Any]:
    """Make the plotly template of the light or the dark page; backgrounds are transparent."""
    ink, grid, menu = ("#e3e6ea", "#3a4048", "#23272d") if dark else ("#1d2126", "#dfe3e8", "#fff")
    axis = {"gridcolor": grid, "linecolor": grid, "zeroline": False, "ticks": "outside"}
    axis |= {"tickcolor": grid, "automargin": True, "title": {"standoff": 8}}
    clear, family = "rgba(0,0,0,0)", {"family": "system-ui, sans-serif"}
    layout = {
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "colorway": list(COLOURS),
        "font": {"color": ink, "size": 12, **family},
        "xaxis": axis,
        "yaxis": axis,
        "scene": theme_of_scenes(dark)["layout"]["scene"],
        "legend": {"bgcolor": clear},
        "updatemenudefaults": {"bgcolor": menu, "bordercolor": OUTLINE, "font": {"color": ink}},
        "annotationdefaults": {"font": {"color": ink}},
        "hoverlabel": {"font": family},
    }
    return {"layout": layout}
