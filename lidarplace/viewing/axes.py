"""Coordinates and axes of a 3-D figure."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_MARGIN = 0.3  # metres


def xyz(points: NDArray[np.floating[Any]]) -> dict[str, NDArray[np.float32]]:
    """Return points, shape (n, 3), as the coordinates of a trace."""
    x, y, z = np.ascontiguousarray(points.T, dtype=np.float32)
    return {"x": x, "y": y, "z": z}


def equal_axes(points: NDArray[np.floating[Any]], longest: float) -> dict[str, Any]:
    """Lay out a scene whose axes have the same scale and hold all points, for plotly.

    Points have shape (n, 3), metres, NaN are left out; the longest axis is in plotly's units."""
    # What lies in the very faces of the axes' cube is drawn in tatters.
    low, high = np.nanmin(points, axis=0) - _MARGIN, np.nanmax(points, axis=0) + _MARGIN
    ratio = longest * (high - low) / (high - low).max()
    layout: dict[str, Any] = {"aspectmode": "manual"}
    layout["aspectratio"] = dict(zip("xyz", ratio.tolist(), strict=True))
    for i, (name, ticks) in enumerate((("x", 6), ("y", 6), ("z", 4))):
        title = {"text": ""}  # would be cut on a narrow page
        layout[f"{name}axis"] = {"range": [low[i], high[i]], "title": title, "nticks": ticks}
    return layout
