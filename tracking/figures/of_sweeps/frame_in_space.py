"""A frame under one rig in space: its cloud, which objects were found, and what was detected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing.axes import equal_axes, xyz
from lidarplace.viewing.scene import CAMERAS
from lidarplace.viewing.solids import edges, headings
from lidarplace.viewing.vehicle import vehicle_surface
from tracking.figures.kit.style import OUTLINE, text

FOUND = {"found": "#0072B2", "found by some seeds": "#CC79A7", "missed": "#D55E00"}
"""Colours of objects, and of the points in them, by what became of them."""
DETECTION = "#009E73"
NEAR_M = (9.0, 9.0, 2.6)
"""Half of what is in view around the object, along x, y and z."""
_CLOSE = {
    "eye": {"x": -1.45, "y": 0.0, "z": 0.85},
    "center": {"x": 0.0, "y": 0.0, "z": -0.15},
    "up": {"x": 0.0, "y": 0.0, "z": 1.0},
}
"""Plotly's camera behind an object."""


def frame_in_space(
    objects: pd.DataFrame,
    shares: NDArray[np.float64],
    points: NDArray[np.float32],
    detections: NDArray[np.float64],
) -> go.Figure:
    """Points in the boxes of objects have the colour of what became of them, others are grey.

    Args:
        objects: of the frame: class, points and the columns of `GEOMETRY`.
        shares: of the seeds that found each, shape (objects,).
        points: x, y, z, shape (n, 3).
        detections: boxes and scores, shape (d, 8).
    """
    plot = go.Figure(layout={"template": None, "margin": dict.fromkeys("lrtb", 0)})
    boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
    fate = np.select([shares == 1, shares > 0], [0, 1], 2)
    owner = box_of_points(points, boxes)
    of_point = np.where(owner >= 0, fate[owner], -1) if len(boxes) else owner
    _add_points(plot, points[of_point < 0], OUTLINE, 1.2)
    for number, shade in enumerate(FOUND.values()):
        _add_points(plot, points[of_point == number], shade, 2.2)
        own = fate == number
        lines = np.concatenate([edges(boxes[own]), headings(boxes[own]).reshape(-1, 3)])
        _add_lines(plot, lines, shade, 4)
    _add_lines(plot, edges(detections[:, :7]), DETECTION, 2)
    roof = boxes[:, :3] + boxes[:, 5:6] * [0, 0, 0.5]
    plot.add_scatter3d(
        **xyz(roof),
        mode="markers",
        marker={"size": 4, "color": [[*FOUND.values()][i] for i in fate]},
        hovertext=[
            f"{text(own['class'])}<br>found by {share:.0%} of the seeds<br>{own['points']:,} points"
            for own, share in zip(objects.to_dict("records"), shares, strict=True)
        ],
        hoverinfo="text",
        showlegend=False,
    )
    return plot


def view_around(box: NDArray[np.float64]) -> dict[str, Any]:
    """Plotly's scene around one of boxes (7,), seen from behind and above."""
    corners = np.stack([box[:3] - NEAR_M, box[:3] + NEAR_M])
    return equal_axes(corners, longest=1.9) | {"camera": _CLOSE}


def view_of(roi: Roi, vehicle: Vehicle | None) -> dict[str, Any]:
    """Plotly's scene of the whole ROI and the vehicle."""
    corners = [[axis[i] for axis in (roi.x, roi.y, roi.z)] for i in range(2)]
    vertices, _ = vehicle_surface(vehicle)
    axes = equal_axes(np.concatenate([corners, vertices]), longest=1.9)
    return axes | {"camera": CAMERAS["from above"]}


def _add_points(plot: go.Figure, points: NDArray[np.float32], shade: str, size: float) -> None:
    plot.add_scatter3d(
        **xyz(points),
        mode="markers",
        marker={"size": size, "color": shade, "line": {"width": 0}},
        hoverinfo="skip",
        showlegend=False,
    )


def _add_lines(plot: go.Figure, line: NDArray[np.floating[Any]], shade: str, width: float) -> None:
    plot.add_scatter3d(
        **xyz(line),
        mode="lines",
        line={"color": shade, "width": width},
        hoverinfo="skip",
        showlegend=False,
    )
