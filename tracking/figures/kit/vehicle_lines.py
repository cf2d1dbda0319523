"""Vehicle from above, from its right side (nose to the right) and in 3D, and maps around it.

It is that of the configuration, or the sedan of the clouds where there is none."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Interval, Roi
from lidarplace.clouds.own_body import sedan
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle, top_near
from lidarplace.rigs.placement import Mount
from lidarplace.scenes.site import Poles
from lidarplace.viewing.axes import xyz
from lidarplace.viewing.solids import edges
from lidarplace.viewing.vehicle import vehicle_boxes, vehicle_surface
from tracking.figures.kit.site_lines import ON_DARK, site_from_above, site_in_space
from tracking.figures.kit.style import OUTLINE, QUIET, SEQUENTIAL, figure

VEHICLE_OUTLINE: dict[str, Any] = {
    "mode": "lines",
    "line": {"color": "#D55E00", "width": 1.5},
    "fill": "toself",
    "fillcolor": "rgba(255, 255, 255, 0.7)",
    **QUIET,
}
"""Style that lightens a map under the vehicle: some eyes lose its orange line alone."""


_outline = lru_cache(maxsize=8)(outline)  # a page draws one vehicle in many figures


def vehicle_outline(vehicle: Vehicle | None, up: str) -> go.Scatter:
    """Draw the outline with x to the right, y or z upwards: from above or from the side."""
    across, upwards = _outline(vehicle or sedan(), (0, "xyz".index(up))).T
    return go.Scatter(x=across, y=upwards, **VEHICLE_OUTLINE)


def extent_of(vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Return lowest and highest corner, metres, shape (2, 3); the origin twice for no body."""
    if not has_body(vehicle):
        return np.zeros((2, 3))
    parts = (vehicle or sedan()).extents
    return np.stack([parts[:, 0].min(axis=0), parts[:, 1].max(axis=0)])


def name_of(vehicle: Vehicle | None) -> str:
    """Name the vehicle, as it follows "of"; one without a body is a site beside the road."""
    if vehicle is None:
        return "a sedan"
    return "the vehicle" if has_body(vehicle) else "the site"


def carried_by(vehicle: Vehicle | None) -> str:
    """Name the carrier of LiDARs, as it follows them."""
    return f"on {name_of(vehicle)}" if has_body(vehicle) else "on poles"


def words_of_maps(vehicle: Vehicle | None) -> str:
    """Explain what is drawn on a map in addition to its colours."""
    if has_body(vehicle):
        return f"LiDARs and {name_of(vehicle)} in orange."
    return f"LiDARs are orange{', lanes and buildings are lines' * isinstance(vehicle, Poles)}."


def words_of_views(vehicle: Vehicle | None) -> str:
    """Explain what leads from LiDARs, and which way they look, from above and from the side."""
    nose = f"the nose of {name_of(vehicle)}" if has_body(vehicle) else "the x axis of the site"
    return (
        f"From above, and from the side; {nose} is on the right. A line leads from above to where "
        "a LiDAR's top leans, from the side to where its front points. x is forward, y to the "
        "left, z above the ground."
    )


def has_body(vehicle: Vehicle | None) -> bool:
    """Test if anything carries the LiDARs; without a body they are on poles."""
    return vehicle is None or bool(len(vehicle.body.extents))


def vehicle_in_space(vehicle: Vehicle | None) -> list[go.Mesh3d | go.Scatter3d]:
    """Make the traces of a vehicle, none for one without a body, or of what is around a site."""
    body, around = vehicle or sedan(), site_in_space(vehicle)
    vertices, faces = vehicle_surface(body)
    if not len(faces):
        return around
    corners = dict(zip("ijk", faces.T.copy(), strict=True))
    surface = go.Mesh3d(
        **xyz(vertices),
        **corners,
        color="#c3ccd5",
        flatshading=True,
        lighting={"ambient": 0.55, "diffuse": 0.7, "specular": 0.1, "roughness": 0.9},
        lightposition={"x": 4000, "y": 6000, "z": 9000},
        name="keep-outs" if isinstance(body, Poles) else "vehicle",
        showlegend=True,
        hoverinfo="skip",
    )
    line = {"color": OUTLINE, "width": 2}
    lines = go.Scatter3d(**xyz(edges(vehicle_boxes(body))), mode="lines", line=line, **QUIET)
    return [*around, surface, lines]


def add_lines(
    plot: go.Figure, line: NDArray[np.floating[Any]], shade: str, width: float, **trace: Any
) -> None:
    """Draw a line in space through points, broken by NaN, shape (n, 3)."""
    style = {"color": shade, "width": width}
    plot.add_scatter3d(**xyz(line), mode="lines", line=style, hoverinfo="skip", **trace)


def posts(mounts: Sequence[Mount], vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Make the posts that carry LiDARs above the body, or the ground without one.

    A line each, broken by NaN, shape (n, 3)."""
    lines = [np.empty((0, 3))]
    for x, y, z in (mount.position.tolist() for mount in mounts):
        top = top_near(vehicle or sedan(), (x, x), (y, y))
        if z > (bottom := top or 0.0):
            lines.append(np.array([[x, y, bottom], [x, y, z], [np.nan] * 3]))
    return np.concatenate(lines)


_CELLS = 200
"""Most cells along the longer side of a map, which is averaged to them: a page holds many."""


def pog_from_above(
    entropy: NDArray[np.float32], roi: Roi, title: str, most: int = _CELLS, unit: str = "nats"
) -> go.Figure:
    """Draw the entropy of columns of voxels, shape (nx, ny), averaged to at most `most` cells."""
    cells, x, y = averaged(entropy, (roi.x, roi.y), most)
    plot = figure(title, height=map_height((y[-1] - y[0]) / (x[-1] - x[0]), 190, 480))
    averages = cells.astype(np.float32)
    return plot.add_heatmap(
        z=averages.T,  # rows of a heat map run along y
        x=x,
        y=y,
        zmin=0.0,
        zmax=float(averages.max()) or 1.0,
        colorscale=SEQUENTIAL,
        colorbar={"title": {"text": unit}, "thickness": 10, "x": 1.03, "len": 1.0},
        hovertemplate=f"x %{{x:.1f}}, y %{{y:.1f}} m<br>%{{z:.3g}} {unit}<extra></extra>",
    )


def add_vehicle(plot: go.Figure, vehicle: Vehicle | None, roi: Roi) -> go.Figure:
    """Outline the vehicle, a sedan for None, or draw what is around a site.

    The vehicle and the whole ROI are in view."""
    is_dark = plot.data[0].type == "heatmap" and plot.data[0].zmin == 0.0  # no difference
    around = site_from_above(vehicle, ON_DARK if is_dark else OUTLINE)
    plot.add_traces([*around, vehicle_outline(vehicle, "y")])
    low, high = extent_of(vehicle)
    ends = zip((roi.x, roi.y), low - 0.5, high + 0.5, strict=False)
    return axes_from_above(plot, *([min(a, first), max(b, last)] for (a, b), first, last in ends))


def axes_from_above(plot: go.Figure, x: Sequence[float], y: Sequence[float]) -> go.Figure:
    """Set equal scales over ranges of x, forward to the right, and y, left upwards."""
    alike = {"constrain": "domain", "showgrid": False}
    plot.update_xaxes(title="x, forward (m)", range=x, **alike)
    return plot.update_yaxes(title="y, left (m)", range=y, scaleanchor="x", **alike)


def map_height(shape: float, least: int, most: int) -> int:
    """Return the height of a figure for a map of this height over its width in a narrow column."""
    return int(np.clip(98 + 265 * shape, least, most))


def averaged(
    cells: NDArray[np.float32], sides: tuple[Interval, Interval], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Average square blocks of cells, shape (n, m), so large that no axis has more than `most`.

    Returns them and the edges of the blocks along both axes; `sides` are the map's extent there."""
    step = -(-max(cells.shape) // most)
    means = cells.astype(np.float64)
    edges = []
    for axis, (low, high) in enumerate(sides):
        n = cells.shape[axis]
        starts = np.arange(0, n, step)
        size = np.diff(np.append(starts, n))
        means = np.add.reduceat(means, starts, axis=axis)
        means /= size[:, None] if axis == 0 else size
        edges.append(low + (high - low) / n * np.append(starts, n))
    return means, edges[0], edges[1]
