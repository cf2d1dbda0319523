"""Lanes and buildings around a site, from above and in 3D."""

from functools import lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.logs.boxes import corners
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.scenes.site import Obstacles, Poles
from lidarplace.viewing.axes import xyz
from lidarplace.viewing.lane_edges import lane_edges
from lidarplace.viewing.solids import edges, triangles
from tracking.figures.kit.style import OUTLINE, QUIET

ON_DARK = "rgba(255, 255, 255, 0.55)"
"""Colour of lines over maps whose colours begin at a dark one, on which grey is lost."""
_LANE = {"color": OUTLINE, "width": 1}
_WALL = {"color": OUTLINE, "width": 2}
_ROOF = "rgba(136, 136, 136, 0.35)"


@lru_cache(maxsize=8)
def _lines(around: Obstacles) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return edges of lanes, and footprints of buildings; broken by NaN, shapes (n, 2)."""
    footprints = np.full((len(around.buildings), 6, 2), np.nan, np.float32)
    footprints[:, :5] = corners(around.buildings)[:, [0, 1, 3, 2, 0], :2]
    return lane_edges(around.lanes), footprints.reshape(-1, 2)


def site_from_above(vehicle: Vehicle | None, shade: str = OUTLINE) -> list[go.Scatter]:
    """Draw lanes and buildings around a site, in `shade`; nothing around a vehicle."""
    if not isinstance(vehicle, Poles):
        return []
    (lane_x, lane_y), (x, y) = (line.T for line in _lines(vehicle.around))
    roofs: dict[str, Any] = {"fill": "toself", "fillcolor": _ROOF, **QUIET}
    return [
        go.Scatter(x=lane_x, y=lane_y, mode="lines", line=_LANE | {"color": shade}, **QUIET),
        go.Scatter(x=x, y=y, mode="lines", line=_WALL | {"color": shade}, **roofs),
    ]


def words_of_site(vehicle: Vehicle | None) -> str:
    """Name what is grey in pictures of poles."""
    around = ", lanes and buildings" if isinstance(vehicle, Poles) else ""
    return f"lines are the poles{around}"


def site_in_space(vehicle: Vehicle | None) -> list[go.Scatter3d]:
    """Draw lanes on the ground and the edges of buildings; nothing around a vehicle."""
    if not isinstance(vehicle, Poles):
        return []
    lanes, _ = _lines(vehicle.around)
    on_ground = np.column_stack([lanes, np.zeros(len(lanes), np.float32)])
    lines = ((on_ground, _LANE), (edges(vehicle.around.buildings), _WALL))
    vertices, faces = triangles(vehicle.around.buildings)
    walls = go.Mesh3d(
        **xyz(vertices),
        **dict(zip("ijk", faces.T.copy(), strict=True)),
        color=OUTLINE,
        opacity=0.2,
        **QUIET,
    )
    return [
        *(go.Scatter3d(**xyz(line), mode="lines", line=style, **QUIET) for line, style in lines),
        walls,
    ]
