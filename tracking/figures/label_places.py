"""Where the labels of a scatter plot go, so that few of them lie on each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_PLOT = (280.0, 215.0)  # pixels of the plotting area on a narrow page
_LETTER = (6.5, 14.0)  # pixels
_GAP = 8.0  # from the middle of a point to its label


def label_places(
    x: NDArray[np.float64], y: NDArray[np.float64], labels: Sequence[str]
) -> list[str]:
    """Plotly's `textposition` for every point, chosen one point after the other.

    Each label takes the side that covers the least of points and labels before it; towards the
    middle of the figure where that is equal, so that no label is cut at the edge.
    """
    at = np.stack([_pixels(x, _PLOT[0]), _pixels(y, _PLOT[1])], axis=1)
    taken = [(*(point - 5), *(point + 5)) for point in at]
    places = []
    for point, label in zip(at, labels, strict=True):
        width, height = _LETTER[0] * len(label), _LETTER[1]
        right = (point[0] + _GAP, point[1] - height / 2)
        left = (point[0] - _GAP - width, point[1] - height / 2)
        boxes = {
            "middle right": right,
            "middle left": left,
            "top center": (point[0] - width / 2, point[1] + _GAP),
            "bottom center": (point[0] - width / 2, point[1] - _GAP - height),
        }
        cost = {}
        for place, (x0, y0) in boxes.items():
            box = (x0, y0, x0 + width, y0 + height)
            outside = max(0.0, -x0) + max(0.0, x0 + width - _PLOT[0])
            cost[place] = sum(_overlap(box, other) for other in taken) + height * outside
        best = min(cost, key=cost.__getitem__)
        places.append(best)
        x0, y0 = boxes[best]
        taken.append((x0, y0, x0 + width, y0 + height))
    return places


def _pixels(values: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Where plotly's automatic range puts `values` along an axis of `length` pixels, roughly."""
    low, high = np.nanmin(values), np.nanmax(values)
    spread = high - low if high > low else 1.0
    return length * (0.06 + 0.88 * (values - low) / spread)


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Area that two boxes (x0, y0, x1, y1) share."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return max(0.0, width) * max(0.0, height)
