"""Optuna's own figures in the style of our pages."""

from __future__ import annotations

from typing import Any

import numpy as np
import plotly.graph_objects as go

from tracking.figures.kit.style import figure, text

_MANY = 100
"""Lists that are longer are packed as arrays, and their texts left out: a page must stay small."""


def from_optuna(drawn: go.Figure, title: str) -> go.Figure:
    """The same figure on the page's background, with long lists of numbers packed as float32."""
    layout = drawn.layout.to_plotly_json()
    width = layout.get("width")
    layout |= figure(text(title), height=420).layout.to_plotly_json() | {"template": None}
    plot = go.Figure({"data": [_packed(trace.to_plotly_json()) for trace in drawn.data]})
    plot.update_layout(layout)
    if width:  # as many panels as there are parameters: they are wider than the page, and scroll
        # A colour bar would be at the far end.
        plot.update_layout(width=width, title_text=f"{text(title)} · later trials are darker")
        plot.update_traces(marker_showscale=False)
    return plot


def _packed(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        # What a mark tells is then its coordinates.
        dropped = {"hovertemplate"} if _long(value.get("text")) else set()
        return {k: _packed(v, k) for k, v in value.items() if k not in dropped}
    if not _long(value):
        return [_packed(v, key) for v in value] if isinstance(value, list | tuple) else value
    if key in ("text", "hovertext"):
        return None
    array = np.asarray(value)
    return array.astype(np.float32) if array.dtype.kind in "fiu" else value


def _long(value: Any) -> bool:
    return isinstance(value, (list, tuple, np.ndarray)) and len(value) > _MANY
