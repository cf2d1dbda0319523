"""Rigs of a search against the baseline: in other cases, and in what they leave unseen."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.side_by_side import side_by_side
from tracking.figures.kit.style import OUTLINE, text
from tracking.figures.kit.vehicle_lines import add_vehicle, pog_from_above
from tracking.run_folders.search_json import Objective


def robustness_figure(
    rows: pd.DataFrame, objective: Objective, reference: str, designed: float
) -> go.Figure:
    """A row a case: the mean, in percent of one value for all rigs; the bar ends at the worst.

    100 % is the value `designed` of the rig `reference`; where that is not positive, values are in
    their own unit. `rows` have rig, case, value and worst of one objective.
    """
    relative = designed > 0
    scale, unit = (100 / designed, "%") if relative else (1.0, text(objective.unit))
    both = scale * rows.set_index(["rig", "case"])[["value", "worst"]]
    bars = pd.DataFrame({"mean": both["value"], "low": both.min(axis=1), "high": both.max(axis=1)})
    columns = {str(rig): bars.loc[rig] for rig in rows["rig"].unique()}
    title = f"percent of {text(reference)} as designed" if relative else text(objective.label)
    plot = side_by_side(
        columns,
        rows["case"].drop_duplicates().tolist(),
        text(objective.name),
        f"{title},<br>{objective.better}",
        shown=f"%{{x:.5~g}} {unit}",
    )
    if relative:
        plot.add_vline(x=100, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    return plot


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

    Both are residual entropy of each column of voxels, nats, shape (nx, ny); `names` are the class,
    the rig of `before` and that of `after`.
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
