"""Coordinates and axes of a 3-D figure."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_MARGIN = 0.3  # metres


def xyz(points: NDArray[np.floating[Any]]) -> dict[str, NDArray[np.float32]]:
    """Points, shape (n, 3), as the coordinates of a trace."""
    x, y, z = np.ascontiguousarray(points.T, dtype=np.float32)
    return {"x": x, "y": y, "z": z}


def equal_axes(points: NDArray[np.floating[Any]], longest: float) -> dict[str, Any]:
    """Plotly's layout of a scene whose axes have the same scale and hold all points.

    Args:
        points: shape (n, 3), metres; NaN are left out.
        longest: length of the longest axis, in plotly's units.
    """
    # What lies in the very faces of the axes' cube is drawn in tatters.
    low, high = np.nanmin(points, axis=0) - _MARGIN, np.nanmax(points, axis=0) + _MARGIN
    ratio = longest * (high - low) / (high - low).max()
    axes = {
        f"{axis}axis": {
            "range": [low[i], high[i]],
            "title": {"text": f"{axis} (m)"},
            "nticks": 6 if axis != "z" else 4,
        }
        for i, axis in enumerate("xyz")
    }
    return {
        **axes,
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
    }
