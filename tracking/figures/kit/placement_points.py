"""Placements as points, each with its own marker and its name."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from tracking.figures.kit.label_places import label_places
from tracking.figures.kit.style import OUTLINE, colour, error_bars, symbol, text


def placement_markers(names: Sequence[str], placements: Sequence[str]) -> dict[str, Any]:
    """Markers of some placements.

    Args:
        names: of those drawn.
        placements: all of the sweep, in order, so that a placement keeps its colour.
    """
    rank = [placements.index(name) for name in names]
    return {"size": 10, "color": [colour(i) for i in rank], "symbol": [symbol(i) for i in rank]}


def add_placements(
    plot: go.Figure,
    x: ArrayLike,
    y: ArrayLike,
    half: ArrayLike,
    names: Sequence[str],
    placements: Sequence[str],
    half_across: ArrayLike | None = None,
    **trace: Any,
) -> None:
    """Draw a named point for each placement, its label where it hides no other.

    Args:
        x, y: of every point, shape (n,).
        half: of the bar up and down, shape (n,), NaN for none.
        names, placements: as of `placement_markers`.
        half_across: of a thinner bar to the left and right.
        trace: what else the trace has.
    """
    across, up, bar = (np.asarray(values, np.float64) for values in (x, y, half))
    bar_across = None if half_across is None else np.asarray(half_across, np.float64)
    if bar_across is not None:
        trace["error_x"] = error_bars(np.nan_to_num(bar_across), thickness=1, color=OUTLINE)
    plot.add_scatter(
        x=across,
        y=up,
        error_y=error_bars(np.nan_to_num(bar), thickness=1.5, color=OUTLINE),
        mode="markers+text",
        text=[text(name) for name in names],
        textposition=label_places(across, up, names, bar, bar_across),
        textfont={"size": 11},
        cliponaxis=False,
        marker=placement_markers(names, placements),
        showlegend=False,
        **trace,
    )
