"""What a rig leaves unseen, from above: before, after and the difference."""

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.from_above import add_vehicle, pog_from_above
from tracking.figures.kit.style import text

_CELLS = 120
"""Cells along the longer side: a page holds three maps a class."""
_DIVERGING = [[0, "#56B4E9"], [0.5, "#f7f7f7"], [1, "#E69F00"]]
"""Blue for less, orange for more."""


def unseen(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    roi: Roi,
    vehicle: Vehicle,
    names: tuple[str, str, str],
) -> list[go.Figure]:
    """Two maps on one scale from 0, and `after - before` on a scale about 0.

    Args:
        before, after: residual entropy of each column of voxels, nats, shape (nx, ny).
        names: the class, the rig of `before` and that of `after`.
    """
    shown, first, second = (text(name) for name in names)
    plots = [
        pog_from_above(before, roi, f"{shown} · unseen by {first}", _CELLS),
        pog_from_above(after, roi, f"{shown} · unseen by {second}", _CELLS),
        pog_from_above(after - before, roi, f"{shown} · {second} less {first}", _CELLS),
    ]
    maps = [plot.data[0] for plot in plots]
    top = max(float(heat.z.max()) for heat in maps[:2]) or 1.0
    for heat in maps[:2]:
        heat.update(zmin=0.0, zmax=top)
    widest = float(np.abs(maps[2].z).max()) or 1.0
    maps[2].update(zmin=-widest, zmax=widest, colorscale=_DIVERGING)
    for plot in plots:
        add_vehicle(plot, vehicle, roi)
    return plots
