"""The section of one frame as each placement sees it."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing.solids import corners
from tracking.figures.kit.style import OUTLINE, add_menu, figure, lidar_colour, text
from tracking.figures.kit.vehicle_lines import add_vehicle
from tracking.findings.groups import has_detectors, pictured
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.run_folders.arrays import Frame

MOST_CLOUDS = 12
"""Placements in the menus: a page must stay small."""
POINTS = 8000
"""Points kept of a placement's cloud, drawn at random."""
_DASHES = {"Car": "solid", "Cyclist": "dash", "Pedestrian": "dot"}


def clouds_section(found: Analysis) -> Section | None:
    """Two views of one frame with menus; None for a sweep without detectors: it has no clouds."""
    run = found.run
    if not has_detectors(run):
        return None
    section = Section("One frame, as each placement sees it", columns=2)
    shown = [name for name in found.order if run.frame is not None and name in run.frame.points]
    shown = shown[:MOST_CLOUDS]
    if run.frame is None or not shown:
        section.notes.append("The run folder has no frame.npz.")
        return section
    if pictured(run):
        section.notes.append(f"The frame is {pictured(run)}.")
    section.notes.append(
        "The same objects under two placements, chosen by the menus: at the start the best and the "
        "last of the ranking. A colour is a LiDAR, outlines are the ground truth; at most "
        "8,000 points are drawn."
    )
    for first in dict.fromkeys((shown[0], shown[-1])):
        section.figures.append(
            point_clouds(
                run.frame, run.roi, run.sweep.body, shown, first, colours=run.sweep.colours
            )
        )
    return section


def point_clouds(
    frame: Frame,
    roi: Roi,
    vehicle: Vehicle | None,
    placements: Sequence[str],
    first: str,
    colours: Mapping[str, str] = MappingProxyType({}),
) -> go.Figure:
    """One placement at a time, a menu chooses; a colour a LiDAR, outlines for the ground truth.

    Args:
        placements: those in the menu, keys of `frame.points`.
        first: the one shown at the start.
        colours: of outlines, by class; grey by default.
    """
    shape = (roi.y[1] - roi.y[0]) / (roi.x[1] - roi.x[0])
    plot = figure(text(first), height=int(np.clip(220 + 450 * shape, 300, 620)))
    owner: list[str] = []
    for name in placements:
        points, lidar = _thinned(frame, roi, name)
        for mount in np.unique(frame.lidar[name]):
            own = points[lidar == mount]
            plot.add_scattergl(
                x=own[:, 0],
                y=own[:, 1],
                mode="markers",
                marker={"size": 2.5, "color": lidar_colour(int(mount))},
                name=f"LiDAR {mount}",
                visible=name == first,
                hoverinfo="skip",
            )
            owner.append(name)
    for object_class in dict.fromkeys(frame.labels.tolist()):
        x, y = _outlines(frame.boxes[frame.labels == object_class])
        plot.add_scatter(
            x=x,
            y=y,
            mode="lines",
            line={
                "color": colours.get(object_class, OUTLINE),
                "width": 1.5,
                "dash": _DASHES.get(object_class, "dash"),
            },
            name=text(object_class),
            hoverinfo="skip",
        )
        owner.append("")
    add_vehicle(plot, vehicle, roi)
    owner.append("")
    plot.update_layout(
        margin={"t": 96}, legend={"orientation": "h", "y": -0.25, "itemsizing": "constant"}
    )
    changes = [
        ({"visible": [who in ("", name) for who in owner]}, {"title.text": text(name)})
        for name in placements
    ]
    active = list(placements).index(first)
    add_menu(plot, [text(name) for name in placements], changes, active, y=1.06)
    return plot


def _thinned(frame: Frame, roi: Roi, name: str) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """At most `POINTS` points over the ROI, x and y, and the mounts that they come from."""
    points = frame.points[name]
    inside = np.flatnonzero(
        (points[:, 0] >= roi.x[0])
        & (points[:, 0] <= roi.x[1])
        & (points[:, 1] >= roi.y[0])
        & (points[:, 1] <= roi.y[1])
    )
    if len(inside) > POINTS:
        inside = np.random.default_rng(0).choice(inside, POINTS, replace=False)
    return np.ascontiguousarray(points[inside, :2], dtype=np.float32), frame.lidar[name][inside]


def _outlines(boxes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rectangles of boxes (m, 7) from above as one line, broken by NaN between boxes."""
    lines = np.full((len(boxes), 6, 2), np.nan)
    lines[:, :5] = corners(boxes)[:, [3, 2, 0, 1, 3], :2]
    x, y = lines.reshape(-1, 2).T
    return x, y
