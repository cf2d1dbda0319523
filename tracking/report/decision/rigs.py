"""The section of the rigs on the vehicle: from above and from the side, all at one scale."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from tracking.figures.kit.rig_picture import AXES_AND_POSTS, PicturedRig, rig_picture
from tracking.figures.kit.style import OUTLINE, figure, lidar_colour, symbol, text
from tracking.figures.kit.vehicle_lines import (
    extent_of,
    name_of,
    posts,
    vehicle_from_above,
    vehicle_from_the_side,
)
from tracking.labels import digits
from tracking.pages.section import Section
from tracking.report.recommendation import Recommendation
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import LidarModel

_VIEW = 120  # pixels of both views
_LINE = 17  # pixels of a mount's line
_TITLE = 48
_AROUND = 0.4  # metres
_AXIS_LENGTH = 0.7  # metres
_BODY = "rgba(136, 136, 136, 0.15)"


@dataclass(frozen=True)
class ViewedRig:
    """A rig and its text.

    Attributes:
        mounts: poses in the ego frame.
        models: of every mount, its text after the pose; plotly text, may be empty.
    """

    mounts: tuple[Mount, ...]
    title: str
    models: tuple[str, ...]


def picture_section(run: RunFolder, found: Recommendation) -> Section:
    """The vehicle with the LiDARs of the best rigs in 3D, for the first screen."""
    lidars = run.sweep.lidars
    rigs = {
        name: PicturedRig.of(run.placements[name], [model_words(m) for m in lidars.get(name, ())])
        for name in found.shown
    }
    note = f"The menu has the best rigs. {AXES_AND_POSTS}"
    return Section("The rigs", [note], [rig_picture(rigs, run.sweep.body)], top=True)


def rigs_section(run: RunFolder, found: Recommendation) -> Section:
    """The best rigs side by side, from above and from the side, with mounts and models."""
    section = Section("Where the LiDARs sit")
    section.notes.append(
        f"From above, and from the side; the nose of {name_of(run.sweep.body)} is on the right. A "
        "line leads from above to where a LiDAR's top leans, from the side to where its front "
        "points; grey posts carry LiDARs above the body. x is forward, y to the left, z above the "
        "ground."
    )
    left = len(found.best.sure) - len(found.shown)
    if left:
        more = f"{left} more {'is' if left == 1 else 'are'} in the report"
        section.notes.append(f"Drawn are the {len(found.shown)} best, {more}.")
    lidars = run.sweep.lidars
    section.figures = rig_views(
        [
            viewed_rig(name, run.placements[name], lidars.get(name, ()), found.best.equal == [name])
            for name in found.shown
        ],
        run.sweep.body,
    )
    return section


def viewed_rig(
    name: str, mounts: Sequence[Mount], models: Sequence[LidarModel], best: bool = False
) -> ViewedRig:
    """A rig to be drawn, with the texts of its LiDARs.

    Args:
        models: of every mount; none if they are not known.
        best: whether it alone has the highest mean.
    """
    words = [model_words(model) for model in models]
    same = len(set(words)) == 1
    said = f"{len(mounts)} LiDAR{'s' * (len(mounts) != 1)}" + (f" · {words[0]}" if same else "")
    prices = [model.price_usd for model in models if model.price_usd is not None]
    if models and len(prices) == len(models):
        said += f" · {sum(prices):,.0f} US$"
    mark = " · highest mean" if best else ""
    return ViewedRig(
        tuple(mounts),
        f"<b>{text(name)}</b>{mark}<br><span style='font-size:12px'>{said}</span>",
        tuple(words) if words and not same else ("",) * len(mounts),
    )


def model_words(model: LidarModel) -> str:
    """A LiDAR model in a few words."""
    low, high = (f"{digits(angle, 'z.3g')}°" for angle in model.elevation_deg)
    kind = "beams" if model.azimuth_steps > 1 else "rays of a pattern"
    beams = f"{model.beams:,} {kind}, {low} to {high}"
    return f"{text(model.name)}, {beams}" if model.name else beams


def rig_views(rigs: Sequence[ViewedRig], vehicle: Vehicle | None) -> list[go.Figure]:
    """A figure for each rig: above its two views, below a line for each mount.

    From above a line leads from a LiDAR to where its top leans, longer the more it does; from the
    side the line is its own x axis, level unless it is pitched. `vehicle` is None for a sedan.
    """
    reach = _reach([mount for rig in rigs for mount in rig.mounts], vehicle)
    most = max(len(rig.mounts) for rig in rigs)
    return [_views(rig, vehicle, reach, most) for rig in rigs]


def _reach(mounts: Sequence[Mount], vehicle: Vehicle | None) -> Mapping[str, tuple[float, float]]:
    """What the views show along x, y and z: the vehicle and every mount, metres."""
    at = np.array([mount.position for mount in mounts] + extent_of(vehicle).tolist())
    low, high = at.min(axis=0) - _AROUND, at.max(axis=0) + _AROUND
    return {axis: (float(low[i]), float(high[i])) for i, axis in enumerate("xyz")}


def _views(
    rig: ViewedRig, vehicle: Vehicle | None, reach: Mapping[str, tuple[float, float]], lines: int
) -> go.Figure:
    below = _LINE * lines
    height = _TITLE + _VIEW + below + 8
    plot = make_subplots(
        figure=figure(rig.title, height=height, margin={"l": 4, "r": 4, "t": _TITLE, "b": 8}),
        rows=2,
        cols=2,
        specs=[[{}, {}], [{"colspan": 2}, None]],
        row_heights=[_VIEW, below],
        vertical_spacing=0.0,
        horizontal_spacing=0.02,
    )
    for column, (outline, across) in enumerate(
        ((vehicle_from_above(vehicle), "y"), (vehicle_from_the_side(vehicle), "z")), start=1
    ):
        plot.add_trace(outline.update(fillcolor=_BODY), row=1, col=column)
        carried = posts(rig.mounts, vehicle).T
        plot.add_scatter(
            x=carried[0],
            y=carried["xyz".index(across)],
            mode="lines",
            line={"color": OUTLINE, "width": 2},
            hoverinfo="skip",
            showlegend=False,
            row=1,
            col=column,
        )
        for i, mount in enumerate(rig.mounts):
            plot.add_trace(_lidar(i, mount, across), row=1, col=column)
        plot.update_xaxes(range=reach["x"], visible=False, constrain="domain", row=1, col=column)
        plot.update_yaxes(
            range=reach[across],
            visible=False,
            constrain="domain",
            scaleanchor=f"x{column if column > 1 else ''}",
            row=1,
            col=column,
        )
    _add_words(plot, rig, lines)
    return plot


def _lidar(i: int, mount: Mount, across: str) -> go.Scatter:
    """A mount as its marker with a line, in the view of x and `across`."""
    axis = 0 if across == "z" else 2
    other = "xyz".index(across)
    start, way = mount.position, _AXIS_LENGTH * mount.rotation[:, axis]
    return go.Scatter(
        x=[start[0], start[0] + way[0]],
        y=[start[other], start[other] + way[other]],
        mode="lines+markers",
        line={"color": lidar_colour(i), "width": 2},
        marker={"size": [9, 0], "color": lidar_colour(i), "symbol": symbol(i), "opacity": 1},
        hovertemplate=f"LiDAR {i + 1}: {_pose(mount)}<extra></extra>",
        showlegend=False,
    )


def _add_words(plot: go.Figure, rig: ViewedRig, lines: int) -> None:
    number = range(len(rig.mounts))
    plot.add_scatter(
        x=[0.0] * len(rig.mounts),
        y=list(number),
        mode="markers+text",
        marker={
            "size": 9,
            "color": [lidar_colour(i) for i in number],
            "symbol": [symbol(i) for i in number],
        },
        text=[
            f" {_pose(mount)}" + (f" · {model}" if model else "")
            for mount, model in zip(rig.mounts, rig.models, strict=True)
        ],
        textposition="middle right",
        textfont={"size": 11},
        hoverinfo="skip",
        cliponaxis=False,
        showlegend=False,
        row=2,
        col=1,
    )
    plot.update_xaxes(range=[-0.03, 1], visible=False, row=2, col=1)
    plot.update_yaxes(range=[lines - 0.5, -0.5], visible=False, row=2, col=1)


def _pose(mount: Mount) -> str:
    """Position, and the angles that are not 0."""
    where = ", ".join(f"{axis} {digits(getattr(mount, axis), 'z.2f')}" for axis in "xyz")
    angles = {name: np.degrees(getattr(mount, name)) for name in ("roll", "pitch", "yaw")}
    turned = [f"{name} {digits(a, '.0f')}°" for name, a in angles.items() if abs(a) >= 0.5]
    return " · ".join([f"{where} m", *([", ".join(turned)] if turned else [])])
