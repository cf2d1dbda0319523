"""Placements as points with markers of their own, and labels that hide few others."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray

from tracking.figures.kit.style import OUTLINE, colour, error_bars, symbol, text

MOST_NAMED = 20
"""Most points of a figure with labels; more would hide each other, and a pointer shows the name."""
_PLOT = (280.0, 215.0)  # pixels of the plotting area on a narrow page
_LETTER = (6.5, 14.0)  # pixels
_GAP = 8.0  # from the middle of a point to its label
_PLACES: tuple[str, ...] = ("middle right", "middle left", "top center", "bottom center")
_PLACES += ("top right", "bottom left", "top left", "bottom right")


def label_places(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    labels: Sequence[str],
    bars: NDArray[np.float64] | None = None,
) -> list[str]:
    """Choose plotly's `textposition` for every point, one point after the other.

    Each label takes the side that covers the least of points, their bars and labels before it. A
    point with the label "" is an obstacle alone. `bars` are lengths along y to each side, NaN or
    0."""
    if sum(map(bool, labels)) > MOST_NAMED:
        return ["middle right"] * len(labels)
    half = np.zeros(len(y)) if bars is None else np.nan_to_num(bars)
    across, ends = _pixels(x, _PLOT[0]), np.concatenate([y - half, y, y + half])
    low, centre, high = np.split(_pixels(ends, _PLOT[1]), 3)  # all are in view
    at = np.stack([across, centre], axis=1)
    taken = [(*(point - 5), *(point + 5)) for point in at]
    taken += [(px - 3, y0, px + 3, y1) for px, y0, y1 in zip(across, low, high, strict=True)]
    places = []
    for point, label in zip(at, labels, strict=True):
        width, height = _LETTER[0] * len(label), _LETTER[1]
        start = {"right": point[0] + _GAP, "left": point[0] - _GAP - width}
        start |= {"center": point[0] - width / 2, "middle": point[1] - height / 2}
        start |= {"top": point[1] + _GAP, "bottom": point[1] - _GAP - height}
        boxes, cost = {}, {}
        for place in _PLACES:
            y0, x0 = (start[side] for side in place.split())
            box = boxes[place] = (x0, y0, x0 + width, y0 + height)
            outside = max(0.0, -box[0]) + max(0.0, box[2] - _PLOT[0])
            cost[place] = sum(_overlap(box, other) for other in taken) + height * outside
        places.append(min(cost, key=cost.__getitem__))
        taken.append(boxes[places[-1]])
    return places


def _pixels(values: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Estimate where plotly's automatic range puts `values` along an axis of `length` pixels."""
    low, high = np.nanmin(values), np.nanmax(values)
    spread = high - low if high > low else 1.0
    return length * (0.06 + 0.88 * (values - low) / spread)


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the area that two boxes (x0, y0, x1, y1) share."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return max(0.0, width) * max(0.0, height)


def add_placements(
    plot: go.Figure,
    x: ArrayLike,
    y: ArrayLike,
    half: ArrayLike,
    names: Sequence[str],
    placements: Sequence[str],
    **trace: Any,
) -> None:
    """Draw a named point for each placement; few of them have labels, placed to hide no other.

    `x`, `y` and `half` of the bar, NaN for none, have shapes (n,); `trace` has further
    attributes of the trace."""
    rank = [placements.index(name) for name in names]
    across, up, bar = (np.asarray(values, np.float64) for values in (x, y, half))
    plot.add_scatter(
        x=across,
        y=up,
        error_y=error_bars(np.nan_to_num(bar), thickness=1.5, color=OUTLINE),
        mode="markers+text" if len(names) <= MOST_NAMED else "markers",
        text=[text(name) for name in names],
        textposition=label_places(across, up, names, bar),
        textfont={"size": 11},
        cliponaxis=False,
        marker={"size": 10, "color": [*map(colour, rank)], "symbol": [*map(symbol, rank)]},
        showlegend=False,
        **trace,
    )
