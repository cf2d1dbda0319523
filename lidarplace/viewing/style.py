"""Colours of the pictures, for light and dark pages."""

import html
from collections.abc import Iterable
from itertools import cycle
from typing import Any

# Okabe and Ito's colours, which colour-blind readers can distinguish; grey in place of black,
# because a figure is read on a white and on a black page.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#999999", "#F0E442")
CLASSES = {"Car": "#D55E00", "Cyclist": "#56B4E9", "Pedestrian": "#B8A800"}
"""Boxes are lines and clouds are points, so a colour may serve a class and a fifth LiDAR. Yellow
is darkened to be seen on white."""
_FURTHER = ("#009E73", "#CC79A7", "#0072B2", "#E69F00")
OUTLINE = "#888888"
"""ROI, vehicle and buildings."""


def class_colours(names: Iterable[str]) -> dict[str, str]:
    """Choose a colour for each class: those of `CLASSES`, and by name in turn for others."""
    others = sorted(set(names) - set(CLASSES))
    return CLASSES | dict(zip(others, cycle(_FURTHER)))


def title(text: str, subtitle: str) -> dict[str, Any]:
    """Lay out a title to the left, and a line below it, for plotly."""
    lower = {"text": subtitle, "font": {"size": 11}}
    return {"text": plain(text), "subtitle": lower, "x": 0, "xref": "paper"}


def plain(text: object) -> str:
    """Escape a text so that plotly finds no HTML."""
    return html.escape(str(text), quote=False)


def theme(dark: bool) -> dict[str, Any]:
    """Return the plotly template of a light or a dark page; backgrounds are transparent."""
    ink, grid = ("#e3e6ea", "#3a4048") if dark else ("#1d2126", "#dfe3e8")
    clear = "rgba(0,0,0,0)"
    axis: dict[str, Any] = dict.fromkeys(("gridcolor", "linecolor", "zerolinecolor"), grid)
    axis |= {"color": ink, "showspikes": False}
    in_space = axis | {"showbackground": False}
    return {
        "layout": {
            "paper_bgcolor": clear,
            "font": {"color": ink, "size": 12, "family": "system-ui, sans-serif"},
            "plot_bgcolor": clear,
            "xaxis": axis,
            "yaxis": axis,
            "scene": {"bgcolor": clear} | dict.fromkeys(("xaxis", "yaxis", "zaxis"), in_space),
            "legend": {"bgcolor": clear},
        }
    }
