"""Frames of a box log from above: a first look at what an import has made of a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.clouds.shapes import between
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, SIZE, corners
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing import style
from lidarplace.viewing.page import write_page
from lidarplace.viewing.solids import headings

FRAMES = 6
"""Frames drawn of a log: the first that hold a box."""
_RECTANGLE = [0, 1, 3, 2, 0]


def write_from_above(path: Path, logs: Mapping[str, BoxLog], title: str) -> None:
    """Write a page of the first frames that hold a box, of each log by its name; raise OSError.

    Several logs are candidates, of which every frame is drawn one after another."""
    log = next(iter(logs.values()))
    numbers = log.frames["frame"][log.frames["frame"].isin(log.boxes["frame"])].iloc[:FRAMES]
    notes = [
        "x is forward, y left. Boxes have the colour of their class and a line to their front; the "
        "vehicle is grey. Hover over a point for its box."
    ]
    if len(logs) > 1:
        notes.append(f"Choose one of {' and '.join(logs)}: it is in front of each title.")
    for name, sizes in log.boxes.groupby("class")[list(SIZE)]:
        sides = " × ".join(f"{side:.2f}" for side in sizes.median())
        notes.append(f"{name}: {len(sizes):,} boxes, {sides} m in the median.")
    figures = [draw_from_above(*each, int(n)) for n in numbers for each in logs.items()]
    boxes = pd.concat([each.boxes for each in logs.values()])
    boxes = boxes[boxes["frame"].isin(numbers)]
    for figure in figures:  # all of the same part of the plane
        figure.update_xaxes(range=_reach(boxes["x"]))
        figure.update_yaxes(range=_reach(boxes["y"]))
    write_page(path, title, notes, figures, cameras={})


def _reach(places: pd.Series) -> list[float]:
    """Return the ends of the places and the vehicle, and a car's length more."""
    return [min(0.0, places.min()) - 5.0, max(0.0, places.max()) + 5.0]


def draw_from_above(name: str, log: BoxLog, number: int) -> go.Figure:
    """Draw the boxes of frame `number`, x forward to the right, y left upwards, equal scales.

    `name` is in front of the title."""
    row = log.frames[log.frames["frame"] == number].iloc[0]
    boxes = log.boxes[log.boxes["frame"] == number]
    figure = go.Figure(layout={"template": style.theme(False), "hovermode": "closest"})
    when = "" if np.isnan(row["timestamp_s"]) else f", t = {row['timestamp_s']:g} s"
    start = f"{name}: " if name else ""
    title = f"{start}{row['scene']}, frame {number}{when}", f"{row['split']}, {len(boxes)} boxes"
    figure.update_layout(title=style.title(*title), margin={"l": 45, "r": 10, "t": 52, "b": 48})
    figure.update_xaxes(title="x, forward (m)")
    figure.update_yaxes(title="y, left (m)", scaleanchor="x", constrain="domain")
    _add(figure, between(Vehicle.car().boxes[:1]), "vehicle", style.OUTLINE, [])
    colours = style.class_colours(log.boxes["class"].unique())
    for kind, of_class in boxes.groupby("class"):
        geometry = of_class[list(GEOMETRY)].to_numpy(np.float64)
        _add(figure, geometry, str(kind), colours[str(kind)], of_class["object_id"].tolist())
    return figure


def _add(
    figure: go.Figure, boxes: NDArray[np.float64], name: str, colour: str, ids: list[str]
) -> None:
    outline = np.full((len(boxes), 6, 2), np.nan)
    outline[:, :5] = corners(boxes)[:, _RECTANGLE, :2]
    lines = np.concatenate([outline.reshape(-1, 2), headings(boxes)[..., :2].reshape(-1, 2)])
    name, line = style.plain(name), {"color": colour, "width": 1.5}
    figure.add_scatter(
        x=lines[:, 0], y=lines[:, 1], mode="lines", line=line, hoverinfo="skip", name=name
    )
    if ids:
        marks: dict[str, Any] = {"mode": "markers", "marker": {"color": colour, "size": 3}}
        labels = [
            f"{style.plain(object_id)}<br>x {x:.1f}, y {y:.1f}, z {z:.2f} m<br>"
            f"{length:.2f} × {width:.2f} × {height:.2f} m<br>yaw {np.degrees(yaw):.0f}°"
            for object_id, (x, y, z, length, width, height, yaw) in zip(ids, boxes, strict=True)
        ]
        marks |= {"hovertext": labels, "hoverinfo": "text", "name": name}
        figure.add_scatter(x=boxes[:, 0], y=boxes[:, 1], **marks)
