"""One frame as each placement sees it."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.logs.boxes import corners
from tracking.figures.kit.style import OUTLINE, QUIET, add_menu, figure, lidar_colour, text
from tracking.figures.kit.vehicle_lines import add_vehicle
from tracking.findings.groups import has_detectors, pictured
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.run_folders.arrays import Frame
from tracking.run_folders.sweep import RunFolder

MOST_CLOUDS = 12  # placements in the menu: a page must stay small
POINTS = 8000  # points kept of a placement's cloud, drawn at random
_DASHES = {"Car": "solid", "Cyclist": "dash", "Pedestrian": "dot"}


def clouds_section(analysis: Analysis) -> Section | None:
    """Show one frame with a menu of placements; None without detectors, and so without clouds."""
    run = analysis.run
    if not has_detectors(run):
        return None
    section = Section("One frame, as each placement sees it", columns=2)
    placements = [
        name for name in analysis.order if run.frame is not None and name in run.frame.points
    ]
    if run.frame is None or not placements:
        section.notes.append("The run folder has no frame.npz.")
        return section
    if pictured(run):
        section.notes.append(f"The frame is {pictured(run)}.")
    section.notes.append(
        "The menu chooses the placement, the best first. A colour is a LiDAR, outlines are the "
        "ground truth; at most 8,000 points are drawn."
    )
    section.figures.append(point_clouds(run, run.frame, placements[:MOST_CLOUDS]))
    return section


def point_clouds(run: RunFolder, frame: Frame, placements: Sequence[str]) -> go.Figure:
    """Draw the clouds of `placements`, the first at the start; outlines are the ground truth."""
    roi, first = run.roi, placements[0]
    shape = (roi.y[1] - roi.y[0]) / (roi.x[1] - roi.x[0])
    plot = figure(text(first), height=int(np.clip(220 + 450 * shape, 300, 620)))
    shades = [(edge / 8, lidar_colour(i)) for i in range(8) for edge in (i, i + 1)]
    marker = {"size": 2.5, "cmin": -0.5, "cmax": 7.5, "colorscale": shades}
    for name in placements:
        points, lidar = _thinned(frame, roi, name)
        plot.add_scattergl(
            x=points[:, 0],
            y=points[:, 1],
            mode="markers",
            marker={**marker, "color": lidar},
            visible=name == first,
            **QUIET,
        )
    for object_class in dict.fromkeys(frame.labels.tolist()):
        boxes = frame.boxes[frame.labels == object_class]
        lines = np.full((len(boxes), 6, 2), np.nan)  # rectangles as one line, broken by NaN
        lines[:, :5] = corners(boxes)[:, [3, 2, 0, 1, 3], :2]
        x, y = lines.reshape(-1, 2).T
        line = {"width": 1.5, "dash": _DASHES.get(object_class, "dash")}
        line["color"] = run.sweep.colours.get(object_class, OUTLINE)
        named = {"name": text(object_class), "showlegend": True, "hoverinfo": "skip"}
        plot.add_scatter(x=x, y=y, mode="lines", line=line, **named)
    add_vehicle(plot, run.sweep.body, roi)
    plot.update_layout(margin={"t": 96}, legend={"orientation": "h", "y": -0.25})
    always = [True] * (len(plot.data) - len(placements))
    changes = [
        ({"visible": [one == name for one in placements] + always}, {"title.text": text(name)})
        for name in placements
    ]
    return add_menu(plot, [text(name) for name in placements], changes, y=1.06)


def _thinned(frame: Frame, roi: Roi, name: str) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Keep at most `POINTS` points over the ROI: x and y, and the mounts that they come from."""
    points = frame.points[name]
    (x, y), (left, right), (back, front) = points[:, :2].T, roi.y, roi.x
    inside = np.flatnonzero((x >= back) & (x <= front) & (y >= left) & (y <= right))
    if len(inside) > POINTS:
        inside = np.random.default_rng(0).choice(inside, POINTS, replace=False)
    return np.ascontiguousarray(points[inside, :2], dtype=np.float32), frame.lidar[name][inside]
