"""The section of rigs and maps: where the LiDARs are, what they cover, what stays unseen."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from lidarplace.base.roi import Interval, Roi
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from tracking.figures.kit.rig_picture import PicturedRig, rig_picture
from tracking.figures.kit.style import SEQUENTIAL, figure, text
from tracking.figures.kit.vehicle_lines import (
    add_vehicle,
    averaged,
    in_view,
    name_of,
    pog_from_above,
    vehicle_from_above,
    vehicle_from_the_side,
)
from tracking.findings.groups import pictured
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder

MOST_MAPS = 12
"""Placements drawn in maps: a page must stay small."""
_CELLS = {"coverage": 160, "residual": 80}
"""Cells along the longer side of a map; a page holds two for every placement."""
_MARK = "#D55E00"
_TOP, _BOTTOM = 44, 170  # pixels around the maps
TwoMaps = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Covered share, in [0, 1], and entropy that no beam covers, nats: of columns of voxels from above,
shape (nx, ny), or of rows from the side, shape (nx, nz)."""


def rigs_section(found: Analysis) -> Section:
    """An interactive picture of the rigs, and where the objects are that they should see."""
    run = found.run
    section = Section("Rigs and traffic", columns=2)
    shown = [name for name in found.order if run.placements.get(name)][:MOST_MAPS]
    if not shown:
        section.notes.append("Where the LiDARs are is not known: evaluate --geometry names it.")
        return section
    section.notes.append(
        f"Left: the LiDARs of one placement on {name_of(run.sweep.body)}; the menu chooses the "
        "placement. "
        "POG: entropy of each column of voxels, where objects may or may not be."
    )
    section.notes += _setting(run)
    section.figures.append(
        rig_picture({name: PicturedRig.of(run.placements[name]) for name in shown}, run.sweep.body)
    )
    for name, entropy in (run.maps.pog if run.maps else {}).items():
        plot = pog_from_above(entropy, run.roi, f"POG · {text(name)}")
        add_vehicle(plot, run.sweep.body, run.roi)
        section.figures.append(plot)
    return section


def coverage_section(found: Analysis) -> Section:
    """Four maps of every placement, the best first."""
    run = found.run
    section = Section("Coverage and residual entropy", columns=2)
    if run.maps is None or not run.maps.residual:
        section.notes.append("The run folder has no maps of residual entropy.")
        return section
    section.notes.append(
        "Left: share of each column of voxels that some beam meets. Right: entropy of all classes "
        "where no beam comes, which is what a placement leaves unseen; one scale for all "
        "placements. Above: from above. Below: from the side, heights stretched. LiDARs and "
        f"{name_of(run.sweep.body)} in orange. Coverage knows no occlusion: a covered voxel may "
        "still be hidden behind an object."
    )
    section.notes += _setting(run)
    shown = [name for name in found.order if name in run.maps.residual][:MOST_MAPS]
    most = (
        densest([run.maps.residual[name] for name in shown], run.roi, run.roi.y),
        densest([run.maps.residual_side[name] for name in shown], run.roi, run.roi.z),
    )
    for name in shown:
        above = (run.maps.coverage[name], run.maps.residual[name])
        side = (run.maps.coverage_side[name], run.maps.residual_side[name])
        body, mounts = run.sweep.body, run.placements[name]
        section.figures.append(coverage_maps(above, side, run.roi, body, text(name), mounts, most))
    if len(shown) < len(run.placements):
        section.notes.append(f"{len(shown)} of {len(run.placements):,} placements are drawn.")
    return section


def _setting(run: RunFolder) -> list[str]:
    return [f"Maps are {pictured(run)}; other settings have their own."] if pictured(run) else []


def coverage_maps(
    above: TwoMaps,
    side: TwoMaps,
    roi: Roi,
    vehicle: Vehicle | None,
    title: str,
    mounts: Sequence[Mount],
    most: tuple[float, float],
) -> go.Figure:
    """Four maps: coverage on the left, residual entropy on the right; from above, from the side.

    Args:
        mounts: drawn as dots.
        most: residual entropy of the brightest colour from above and from the side, nats a square
            metre, so that the maps of several placements share their scales; `densest`.
    """
    depth, length = roi.y[1] - roi.y[0], roi.x[1] - roi.x[0]
    drawn = int(np.clip(205 * 1.4 * depth / length, 160, 560))  # pixels of both rows
    plot = make_subplots(
        figure=figure(
            title, height=drawn + _TOP + _BOTTOM, margin={"l": 56, "r": 16, "t": _TOP, "b": _BOTTOM}
        ),
        rows=2,
        cols=2,
        row_heights=[0.75, 0.25],
        vertical_spacing=0.1,
        horizontal_spacing=0.05,
        shared_xaxes=True,
        shared_yaxes=True,
    )
    for row, (seen, other) in enumerate(((above, roi.y), (side, roi.z)), start=1):
        for column, name in enumerate(("coverage", "residual"), start=1):
            limit = 100.0 if name == "coverage" else most[row - 1]
            map_ = _map(seen, (roi, other), name, row, limit, drawn)
            plot.add_trace(map_, row=row, col=column)
            outline = (vehicle_from_above if row == 1 else vehicle_from_the_side)(vehicle)
            plot.add_trace(outline, row=row, col=column)
            plot.add_trace(_dots(mounts, row), row=row, col=column)
    _axes(plot, in_view(vehicle, roi))
    return plot


def densest(residual: Sequence[NDArray[np.float32]], roi: Roi, other: Interval) -> float:
    """The largest residual entropy that any of these maps shows, nats a square metre.

    `other` is the interval of y for maps from above, of z for those from the side.
    """
    cells = (averaged(map_, (roi.x, other), _CELLS["residual"])[0] for map_ in residual)
    return max((float(c.max()) for c in cells), default=0.0) / roi.resolution**2


def _map(
    seen: TwoMaps, over: tuple[Roi, Interval], name: str, row: int, limit: float, drawn: int
) -> go.Heatmap:
    roi, other = over
    values = seen[0] if name == "coverage" else seen[1]
    cells, x, y = averaged(values, (roi.x, other), _CELLS[name])
    if name == "coverage":
        shown, bar = np.rint(100 * cells).astype(np.uint8), _bar("covered (%)", 0.0, 0, drawn)
        hover = "%{z} % covered"
    else:
        shown = (cells / roi.resolution**2).astype(np.float32)
        side = "from above" if row == 1 else "from the side"
        bar = _bar(f"residual entropy<br>{side} (nats/m²)", 0.525, row - 1, drawn)
        hover = "%{z:.3g} nats/m²"
    place = "x %{x:.1f}, " + ("y" if row == 1 else "z") + " %{y:.1f} m<br>"
    return go.Heatmap(
        z=shown.T,  # rows of a heat map run along the second axis
        x=x,
        y=y,
        zmin=0,
        zmax=limit or 1.0,
        colorscale=SEQUENTIAL,
        showscale=name == "residual" or row == 1,
        colorbar=bar,
        hovertemplate=place + hover + "<extra></extra>",
    )


def _bar(title: str, left: float, number: int, drawn: int) -> dict[str, Any]:
    """A colour bar below the maps; `number` bars of its column are above it."""
    return {
        "title": {"text": title, "side": "bottom", "font": {"size": 11}},
        "orientation": "h",
        "thickness": 8,
        "len": 0.475,
        "x": left,
        "xanchor": "left",
        "y": -(44 + 64 * number) / drawn,
        "yanchor": "top",
        "ypad": 0,
        "nticks": 6,
    }


def _dots(mounts: Sequence[Mount], row: int) -> go.Scatter:
    return go.Scatter(
        x=[mount.x for mount in mounts],
        y=[mount.y if row == 1 else mount.z for mount in mounts],
        mode="markers",
        marker={"size": 5, "color": _MARK, "line": {"color": "#ffffff", "width": 1}},
        hovertemplate="LiDAR at %{x:.2f}, %{y:.2f} m<extra></extra>",
        showlegend=False,
    )


def _axes(plot: go.Figure, ranges: Sequence[Sequence[float]]) -> None:
    """Of x, y and z, metres."""
    x, y, z = ranges
    plot.update_xaxes(range=x, showgrid=False, ticks="outside")
    plot.update_xaxes(title={"text": "x, forward (m)", "standoff": 2}, row=2)
    plot.update_yaxes(showgrid=False)
    plot.update_yaxes(range=y, title="y, left (m)", row=1, col=1)
    plot.update_yaxes(range=z, title="z, up (m)", nticks=4, row=2, col=1)
