"""Rigs on the vehicle, from above and from the side, all at one scale."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from tracking.figures.kit.grounds import detected_grounds, ground_note, with_grounds_of_folder
from tracking.figures.kit.rig_picture import PicturedRig, axes_and_posts, rig_picture
from tracking.figures.kit.site_lines import site_from_above, words_of_site
from tracking.figures.kit.style import OUTLINE, QUIET, figure, lidar_colour, symbol, text
from tracking.figures.kit.vehicle_lines import (
    extent_of,
    has_body,
    posts,
    vehicle_outline,
    words_of_views,
)
from tracking.findings.failures import Failures
from tracking.labels import digits
from tracking.pages.section import Section
from tracking.report.recommendation import Recommendation
from tracking.run_folders.sweep_json import LidarModel

_VIEW = 120  # pixels of both views
_LINE = 17  # pixels of a mount's line
_TITLE = 48
_AROUND = np.full(3, 0.4)  # metres
_AROUND_POLES = np.array([6.0, 6.0, 0.4])  # with the lanes next to them
_AXIS_LENGTH = 0.7  # metres
_BODY = "rgba(136, 136, 136, 0.15)"
Viewed = tuple[str, PicturedRig]
"""Title as plotly text, and the rig with the text behind the pose of every mount."""


def picture_section(recommended: Recommendation, pair: Failures | None) -> Section:
    """Draw the vehicle with the LiDARs of the best rigs in 3D, for the first screen.

    The ground of the two rigs of `pair` is also coloured by what their detectors found."""
    run, lidars = recommended.run, recommended.run.sweep.lidars
    rigs = {
        name: PicturedRig.of(run.placements[name], [_model_words(m) for m in lidars.get(name, ())])
        for name in recommended.drawn
    }
    rigs = with_grounds_of_folder(rigs, run.path, run.sweep.classes, run.sweep.body)
    if pair is not None:
        for name, ground in detected_grounds(pair).items():
            rigs[name] = replace(rigs[name], detected=ground)
    words = axes_and_posts(run.sweep.body)
    notes = [f"Choose one of the best rigs in the menu. {words}", ground_note(rigs)]
    picture = rig_picture(rigs, run.sweep.body)
    return Section("The rigs", [*filter(None, notes)], [picture], place="picture")


def rigs_section(recommended: Recommendation) -> Section:
    """Draw the best rigs side by side, from above and from the side, with mounts and models."""
    run, names = recommended.run, recommended.drawn
    body = run.sweep.body
    grey = "posts carry LiDARs above the body" if has_body(body) else words_of_site(body)
    note = f"{words_of_views(body)} Grey {grey}."
    section = Section("Where the LiDARs sit", [note])
    if left := len(recommended.best.sure) - len(names):
        more = f"{left} more {'is' if left == 1 else 'are'} in the report"
        section.notes.append(f"Drawn are the {len(names)} best, {more}.")
    rigs, lidars = run.placements, run.sweep.lidars
    drawn = [
        viewed_rig(name, rigs[name], lidars.get(name, ()), recommended.best.equal == [name])
        for name in names
    ]
    section.figures = rig_views(drawn, run.sweep.body)
    return section


def viewed_rig(
    name: str, mounts: Sequence[Mount], models: Sequence[LidarModel], best: bool = False
) -> Viewed:
    """Describe a rig to be drawn: its title and the texts of its LiDARs.

    `models` is empty if they are not known; `best`: whether the rig alone has the highest mean."""
    words = [_model_words(model) for model in models]
    same = len(set(words)) == 1
    description = f"{len(mounts)} LiDAR{'s' * (len(mounts) != 1)}" + (
        f" · {words[0]}" if same else ""
    )
    prices = [model.price_usd for model in models if model.price_usd is not None]
    if models and len(prices) == len(models):
        description += f" · {sum(prices):,.0f} US$"
    mark = " · highest mean" if best else ""
    title = f"<b>{text(name)}</b>{mark}<br><span style='font-size:12px'>{description}</span>"
    return title, PicturedRig.of(mounts, () if same else words)


def _model_words(model: LidarModel) -> str:
    """Describe a LiDAR model in a few words."""
    low, high = (f"{digits(angle, 'z.3g')}°" for angle in model.elevation_deg)
    kind = "beams" if model.azimuth_steps > 1 else "rays of a pattern"
    beams = f"{model.beams:,} {kind}, {low} to {high}"
    return f"{text(model.name)}, {beams}" if model.name else beams


def rig_views(rigs: Sequence[Viewed], vehicle: Vehicle | None) -> list[go.Figure]:
    """Draw a figure for each rig: above its two views, below a line for each mount.

    From above a line leads from a LiDAR to where its top leans, longer the more it does; from the
    side the line is its own x axis, level unless it is pitched. `vehicle` is None for a sedan."""
    reach = _reach([mount for _, rig in rigs for mount in rig.mounts], vehicle)
    most = max(len(rig.mounts) for _, rig in rigs)
    return [_views(rig, vehicle, reach, most) for rig in rigs]


def _reach(mounts: Sequence[Mount], vehicle: Vehicle | None) -> Mapping[str, tuple[float, float]]:
    """Find the range along x, y and z that holds the vehicle and every mount, metres.

    Without a vehicle it holds the ground, too."""
    at = np.array([mount.position for mount in mounts] + extent_of(vehicle).tolist())
    around = _AROUND if has_body(vehicle) else _AROUND_POLES
    low, high = at.min(axis=0) - around, at.max(axis=0) + around
    return {axis: (float(low[i]), float(high[i])) for i, axis in enumerate("xyz")}


def _views(
    viewed: Viewed, vehicle: Vehicle | None, reach: Mapping[str, tuple[float, float]], lines: int
) -> go.Figure:
    (title, rig), height_of_lines = viewed, _LINE * lines
    height = _TITLE + _VIEW + height_of_lines + 8
    plot = make_subplots(
        figure=figure(title, height=height, margin={"l": 4, "r": 4, "t": _TITLE, "b": 8}),
        rows=2,
        cols=2,
        specs=[[{}, {}], [{"colspan": 2}, None]],
        row_heights=[_VIEW, height_of_lines],
        vertical_spacing=0.0,
        horizontal_spacing=0.02,
    )
    carried = posts(rig.mounts, vehicle).T
    for column, across in enumerate("yz", start=1):
        place = {"row": 1, "col": column}
        for trace in site_from_above(vehicle) if across == "y" else ():
            plot.add_trace(trace, **place)
        plot.add_trace(vehicle_outline(vehicle, across).update(fillcolor=_BODY), **place)
        plot.add_scatter(
            x=carried[0],
            y=carried["xyz".index(across)],
            mode="lines",
            line={"color": OUTLINE, "width": 2},
            **QUIET,
            **place,
        )
        for i, mount in enumerate(rig.mounts):
            plot.add_trace(_lidar(i, mount, across), **place)
        hidden = {"visible": False, "constrain": "domain"} | place
        plot.update_xaxes(range=reach["x"], **hidden)
        scaled = f"x{column if column > 1 else ''}"
        plot.update_yaxes(range=reach[across], scaleanchor=scaled, **hidden)
    number, both = range(len(rig.mounts)), zip(rig.mounts, rig.words, strict=True)
    plot.add_scatter(
        x=[0.0] * len(number),
        y=list(number),
        mode="markers+text",
        marker={"size": 9, "color": [*map(lidar_colour, number)], "symbol": [*map(symbol, number)]},
        text=[
            f" {i}: {_pose(mount)}" + (f" · {model}" if model else "")
            for i, (mount, model) in enumerate(both, start=1)
        ],
        textposition="middle right",
        textfont={"size": 11},
        cliponaxis=False,
        **QUIET,
        row=2,
        col=1,
    )
    plot.update_xaxes(range=[-0.03, 1], visible=False, row=2, col=1)
    return plot.update_yaxes(range=[lines - 0.5, -0.5], visible=False, row=2, col=1)


def _lidar(i: int, mount: Mount, across: str) -> go.Scatter:
    """Draw a mount as its marker with a line, in the view of x and `across`."""
    axis = 0 if across == "z" else 2
    other = "xyz".index(across)
    start, direction = mount.position, _AXIS_LENGTH * mount.rotation[:, axis]
    return go.Scatter(
        x=[start[0], start[0] + direction[0]],
        y=[start[other], start[other] + direction[other]],
        mode="lines+markers",
        line={"color": lidar_colour(i), "width": 2},
        marker={"size": [9, 0], "color": lidar_colour(i), "symbol": symbol(i), "opacity": 1},
        hovertemplate=f"LiDAR {i + 1}: {_pose(mount)}<extra></extra>",
        showlegend=False,
    )


def _pose(mount: Mount) -> str:
    """Format the position, and the angles that are not 0."""
    where = ", ".join(f"{axis} {digits(getattr(mount, axis), 'z.2f')}" for axis in "xyz")
    angles = {name: np.degrees(getattr(mount, name)) for name in ("roll", "pitch", "yaw")}
    turned = [f"{name} {digits(a, '.0f')}°" for name, a in angles.items() if abs(a) >= 0.5]
    return " · ".join([f"{where} m", *([", ".join(turned)] if turned else [])])
