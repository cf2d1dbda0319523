"""Colours, templates and small helpers that all figures share."""

from __future__ import annotations

import html
from typing import Any

import plotly.graph_objects as go

from lidarplace.viewing.style import COLOURS, OUTLINE
from lidarplace.viewing.style import theme as theme_of_scenes

SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "cross")
SEQUENTIAL = "Cividis"

VEHICLE = (4.7, 1.9)
"""Length and width of the outline drawn for the vehicle, metres: a middle-class car."""


def colour(index: int) -> str:
    """The colour of the `index`-th of several things; repeats after eight."""
    return COLOURS[index % len(COLOURS)]


def symbol(index: int) -> str:
    """The marker of the `index`-th of several things; changes when the colours repeat."""
    return SYMBOLS[index // len(COLOURS) % len(SYMBOLS)]


def text(value: object) -> str:
    """A user's text as plotly shall show it: plotly reads tags in titles and labels."""
    return html.escape(str(value), quote=False)


_TITLE = {
    "x": 0,
    "xref": "paper",
    "font": {"size": 14},
    "y": 1,
    "yref": "container",
    "yanchor": "top",
    "pad": {"t": 12},
}


def figure(title: str, height: int, **layout: Any) -> go.Figure:
    """An empty figure as wide as its container. `title` may hold tags, names go in by `text`."""
    margin = {"l": 56, "r": 16, "t": 48, "b": 48}
    return go.Figure(
        layout={
            "title": {"text": title, **_TITLE},
            "height": height,
            "margin": margin,
            "dragmode": False,
            "template": None,
            **layout,
        }
    )


def legend_below(plot: go.Figure, entries: int) -> None:
    """Put the legend under the axis' title, in rows of two; the figure grows by their height."""
    room = 20 * -(-entries // 2)
    plot.update_layout(
        height=plot.layout.height + room,
        margin={"b": 56 + room},
        legend={"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom"},
    )


def theme(dark: bool) -> dict[str, Any]:
    """The plotly template of the light or the dark page; backgrounds are transparent."""
    ink, grid, menu = ("#e3e6ea", "#3a4048", "#23272d") if dark else ("#1d2126", "#dfe3e8", "#fff")
    axis = {
        "gridcolor": grid,
        "linecolor": grid,
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": grid,
        "automargin": True,
        "title": {"standoff": 8},
    }
    return {
        "layout": {
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "colorway": list(COLOURS),
            "font": {"color": ink, "size": 12, "family": "system-ui, sans-serif"},
            "xaxis": axis,
            "yaxis": axis,
            "scene": theme_of_scenes(dark)["layout"]["scene"],
            "legend": {"bgcolor": "rgba(0,0,0,0)"},
            "updatemenudefaults": {
                "bgcolor": menu,
                "bordercolor": OUTLINE,
                "font": {"color": ink},
            },
            "annotationdefaults": {"font": {"color": ink}},
            "hoverlabel": {"font": {"family": "system-ui, sans-serif"}},
        }
    }
