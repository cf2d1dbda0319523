"""A frame under one placement as an interactive 3D picture."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.shapes import between
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.viewing import style
from lidarplace.viewing.axes import equal_axes, xyz
from lidarplace.viewing.frame import Frame, read_cloud, read_frame
from lidarplace.viewing.solids import edges, headings, triangles
from lidarplace.viewing.vehicle import Surface, add_lidars, vehicle_surface

POINTS = 160_000
"""Points drawn of a frame: 16 bytes each in a page, and still turned smoothly."""


def _at(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


CAMERAS = {
    "from behind": {"eye": _at(-2.2, 0, 1.2), "center": _at(0, 0, -0.45), "up": _at(0, 0, 1)},
    "from above": {"eye": _at(0, 0, 2.8), "center": _at(0, 0, 0), "up": _at(1, 0, 0)},
}
"""Plotly's cameras; the first is the one at the start."""


def draw_frame(
    log: BoxLog,
    number: int,
    placement: Placement,
    crop: Crop,
    points: int = POINTS,
    misaligned_heights: bool = False,
    vehicle: Vehicle | None = None,
) -> go.Figure:
    """Draw frame `number` of `log` as `placement` sees it, in 3D.

    Points have the colour of their LiDAR, boxes that of their class, with a line on the roof
    towards the front. ROI, vehicle and buildings are grey. Of a cloud of more than `points` so many
    are drawn, chosen at random. Other arguments and errors as of `read_cloud` and `read_frame`."""
    frame = read_frame(log, number, crop)
    cloud = read_cloud(frame, placement, crop, points, misaligned_heights, vehicle)
    drawn, lidar, returned, on_objects = cloud
    body = vehicle_surface(vehicle)
    mounts = [mount.position for mount in placement.mounts]
    seen = np.concatenate([np.reshape(crop, (2, 3)), body[0], mounts])
    axes = equal_axes(seen, longest=2.0) | {"camera": CAMERAS["from behind"]}
    count = f"{returned:,} points" + (f", {len(drawn):,} drawn" if len(drawn) < returned else "")
    figure = go.Figure(layout={"template": style.theme(False), "scene": axes})
    figure.update_layout(
        title=style.title(placement.name, f"{count}, {on_objects.sum():,} on objects"),
        height=400,
        margin={"l": 10, "r": 10, "t": 48, "b": 0},
        legend={"itemsizing": "constant"},
        hovermode="closest",
    )
    for i in range(len(placement.mounts)):
        shade, name = style.COLOURS[i % len(style.COLOURS)], f"LiDAR {i + 1}"
        marker = {"size": 1.2, "color": shade, "line": {"width": 0}}
        trace: dict[str, Any] = {"hoverinfo": "skip", "name": name, "legendgroup": name}
        figure.add_scatter3d(**xyz(drawn[lidar == i]), mode="markers", marker=marker, **trace)
    add_lidars(figure, placement)
    _add_objects(figure, frame, on_objects, style.class_colours(log.boxes["class"].unique()))
    _add_surroundings(figure, frame, crop, body)
    return figure


def _add_objects(
    figure: go.Figure, frame: Frame, on_objects: NDArray[np.int64], colours: Mapping[str, str]
) -> None:
    """Add a trace of lines for each class, and one of marks at the fronts with a label."""
    present = frame.objects["class"]
    for name, shade in colours.items():
        objects = frame.objects[present == name]
        points = on_objects[present == name]
        boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
        if boxes.size == 0:
            continue
        front = headings(boxes)
        lines = xyz(np.concatenate([edges(boxes), front.reshape(-1, 3)]))
        trace: dict[str, Any] = {"name": style.plain(name), "legendgroup": name}
        line, marker = {"color": shade, "width": 4}, {"size": 3, "color": shade}
        figure.add_scatter3d(**lines, mode="lines", line=line, hoverinfo="skip", **trace)
        trace |= {"mode": "markers", "marker": marker, "hoverinfo": "text", "showlegend": False}
        labels = [
            f"{style.plain(object_id)}<br>x {x:.1f}, y {y:.1f} m<br>"
            f"{length:.1f} × {width:.1f} × {height:.1f} m<br>{count:,} points"
            for object_id, (x, y, _, length, width, height, _), count in zip(
                objects["object_id"], boxes, points, strict=True
            )
        ]
        figure.add_scatter3d(**xyz(front[:, 1]), hovertext=labels, **trace)


def _add_surroundings(figure: go.Figure, frame: Frame, crop: Crop, body: Surface) -> None:
    roi, line = edges(between(np.reshape(crop, (1, 2, 3)))), {"color": style.OUTLINE, "width": 2}
    grey: dict[str, Any] = {"color": style.OUTLINE, "hoverinfo": "skip", "showlegend": True}
    figure.add_scatter3d(**xyz(roi), mode="lines", line=line, hoverinfo="skip", name="ROI")
    for name, (vertices, faces), opacity in (
        ("vehicle", body, 0.8),
        ("buildings", triangles(frame.buildings), 0.25),
    ):
        if len(faces):
            i, j, k = faces.T.copy()
            figure.add_mesh3d(
                **xyz(vertices), i=i, j=j, k=k, name=name, opacity=opacity, flatshading=True, **grey
            )
