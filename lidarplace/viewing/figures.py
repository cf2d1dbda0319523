"""Figures of what the library computes, by its class: `placement.plot()` and others like it."""

from functools import singledispatch

import numpy as np
import plotly.graph_objects as go

from lidarplace.logs.boxes import corners
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.result import Surrogates
from lidarplace.rigs.placement import Placement
from lidarplace.viewing import style
from lidarplace.viewing.axes import equal_axes, xyz
from lidarplace.viewing.solids import edges
from lidarplace.viewing.vehicle import add_lidars, vehicle_boxes


@singledispatch
def figure(thing: object) -> go.Figure:
    """Draw the figure of a thing, in the style of light pages."""
    raise TypeError(f"there is no figure of a {type(thing).__name__}")


@figure.register
def _placement(placement: Placement) -> go.Figure:
    """Draw LiDARs on the box of the vehicle, each with the direction of its x axis."""
    body, plot = vehicle_boxes(None), _new(placement.name)
    line = {"color": style.OUTLINE, "width": 3}
    plot.add_scatter3d(**xyz(edges(body)), mode="lines", line=line, name="vehicle")
    add_lidars(plot, placement, pointer=0.5)
    at = np.array([mount.position for mount in placement.mounts])
    plot.update_layout(scene=equal_axes(np.concatenate([corners(body)[0], at]), longest=1.6))
    return plot


@figure.register
def _grid(grid: OccupancyGrid) -> go.Figure:
    """Draw the highest p of every column from above, the vehicle driving upwards."""
    highest = grid.counts.max(axis=2) / grid.frames
    plot = _new(f"{grid.object_class}: highest p of every column")
    plot.add_heatmap(
        x=grid.roi.centres(1), y=grid.roi.centres(0), z=highest, colorbar={"title": {"text": "p"}}
    )
    plot.update_xaxes(title="y (m)", autorange="reversed", constrain="domain")
    plot.update_yaxes(title="x (m)", scaleanchor="x")
    return plot


@figure.register
def _surrogates(result: Surrogates) -> go.Figure:
    plot = _new("Entropy of the POG")
    y = [result.placement.name]
    for name, value, shade in (
        ("covered", result.covered_entropy, style.COLOURS[2]),
        ("residual", result.residual_entropy, style.OUTLINE),
    ):
        plot.add_bar(x=[value], y=y, orientation="h", name=name, marker_color=shade)
    plot.update_layout(barmode="stack", height=220)
    plot.update_xaxes(title="nats")
    return plot


def _new(title: str) -> go.Figure:
    heading = {"text": style.plain(title)}
    return go.Figure(layout={"template": style.theme(False), "title": heading})
