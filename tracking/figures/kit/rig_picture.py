"""Vehicle, zones, the LiDARs of a rig and the ground in 3D; a menu chooses the rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.recall_ground import REACH_M, RecallGround
from lidarplace.rigs.placement import Mount
from lidarplace.viewing.axes import equal_axes, xyz
from tracking.figures.kit.site_lines import words_of_site
from tracking.figures.kit.style import OUTLINE, QUIET, TOLD, add_menu, figure, lidar_markers, text
from tracking.figures.kit.vehicle_lines import (
    add_lines,
    extent_of,
    has_body,
    posts,
    vehicle_in_space,
)
from tracking.run_folders.search_json import UNNAMED, Zone

_AXES = (("x", "#D55E00"), ("y", "#009E73"), ("z", "#0072B2"))
"""Axes of a sensor, in colours that colour-blind readers can distinguish."""
_AXIS_LENGTHS = 1.5, 0.3
"""Length of a sensor's axes without and with a body, metres."""
_LEAST_SITE_M = 20.0
"""Length of a site in pictures at least, metres."""
_DISTANCES = 1.6, 4.0
"""Distance of the camera from the vehicle without and with a ground, lengths of the vehicle."""
_DISTANCE_OF_SITES = 2.0
"""The same from a site, in lengths of the region of its poles."""
_EYE = np.array([0.72, 0.58, 0.6])
"""Direction from the vehicle to the camera."""
_LONGEST = 1.9
"""Longest axis of the scene in plotly's units."""
_GROUND = ((0.0, "#e8a87c"), (0.5, "#f4efe4"), (1.0, "#7fbbe0"))
"""Colours of the ground: orange where little is found, blue where much is."""
_INK = "#1d2126"
"""Colour of text over the ground, which is bright on a dark page, too."""
_LABELS = 0.055
"""Least distance between numbers of LiDARs, in distances of the camera."""


def axes_and_posts(vehicle: Vehicle | None) -> str:
    """Explain the lines of a picture."""
    length, rack = _AXIS_LENGTHS[has_body(vehicle)], "the rack that LiDARs above the body need"
    posts_are = f"posts are {rack}" if has_body(vehicle) else words_of_site(vehicle)
    axes = f"Lines at a LiDAR are the sensor's axes, {length:g} m long"
    return f"Drag to turn, scroll to zoom. {axes}; grey {posts_are}."


@dataclass(frozen=True)
class PicturedRig:
    """Mounts, and plotly text of each next to its pose, such as its LiDAR model; may be empty.

    `ground` is coloured if it is known; with `dead`, a LiDAR's number from 0, by its degraded
    recall. `detected` is the recall of a sweep's detectors."""

    mounts: tuple[Mount, ...]
    words: tuple[str, ...]
    ground: RecallGround | None = None
    detected: RecallGround | None = None
    dead: int | None = None

    @classmethod
    def of(cls, mounts: Sequence[Mount], words: Sequence[str] = ()) -> PicturedRig:
        """Make a rig of mounts, and of the `words` about each if they are known."""
        return cls(tuple(mounts), tuple(words) or ("",) * len(mounts))

    @classmethod
    def in_zones(
        cls, mounts: Sequence[Mount], models: Sequence[str], zones: Sequence[str | None]
    ) -> PicturedRig:
        """Make a rig of a search, with the names of models and zones by mount."""
        pairs = zip(models, zones, strict=True)
        words = [text(model) + (f", zone {text(zone)}" if zone else "") for model, zone in pairs]
        return cls(tuple(mounts), tuple(words))

    @property
    def models(self) -> list[str]:
        """Models of the mounts: their words up to the first comma."""
        return [words.partition(",")[0] for words in self.words]


def rig_picture(
    rigs: Mapping[str, PicturedRig], vehicle: Vehicle | None, zones: Sequence[Zone] = ()
) -> go.Figure:
    """Draw rigs by their names in a menu, the first one at the start.

    A rig with a ground is followed by the same one with its worst LiDAR dead, and with the ground
    as detected. A sedan carries them for a `vehicle` of None; LiDARs may sit in `zones`."""
    carried = has_body(vehicle)
    title = "LiDARs on the vehicle" if carried else "LiDARs on poles"
    plot = figure(title, height=440, margin={"l": 0, "r": 0, "t": 70, "b": 48})
    plot.add_traces(vehicle_in_space(vehicle))
    states = {state: rig for name, rig in rigs.items() for state, rig in _states(name, rig)}
    with_ground = any(rig.ground for rig in states.values())
    _add_rings(plot, vehicle, with_ground or not carried)
    if zones:
        _add_zones(plot, zones)
    owner = [""] * len(plot.data)
    first, length = next(iter(states)), float(np.ptp(extent_of(vehicle)[:, 0]))
    distance = _DISTANCES[with_ground] * length
    if not carried:
        distance = _DISTANCE_OF_SITES * _spread(rigs.values())
    colours = _colours([rig.ground for rig in rigs.values()])
    colours_as_detected = _colours([rig.detected for rig in rigs.values()])
    for name, rig in states.items():
        before = len(plot.data)
        if rig.ground is not None:
            _add_ground(plot, rig.ground, rig.dead is not None, colours)
        elif rig.detected is not None:
            _add_cells(plot, rig.detected, rig.detected.built, colours_as_detected)
        _add_rig(plot, rig, vehicle, _LABELS * distance)
        owner += [name] * (len(plot.data) - before)
    for trace, rig_name in zip(plot.data, owner, strict=True):
        trace.visible = rig_name in ("", first)
    # Axes of equal scale that hold every rig, so that the menu does not move the picture.
    points = np.concatenate([_points(trace) for trace in plot.data])
    scene = equal_axes(points, longest=_LONGEST)
    for axis in "xyz":  # the rings on the ground are the scale
        scene[f"{axis}axis"]["visible"] = False
    plot.update_layout(
        scene=scene | {"camera": _camera(scene, vehicle, distance), "dragmode": "turntable"},
        legend={"orientation": "h", "y": 0, "yanchor": "top", "itemsizing": "constant"},
    )
    changes = [({"visible": [rig_name in ("", name) for rig_name in owner]},) for name in states]
    return add_menu(plot, [text(name) for name in states], changes, y=1)


def _spread(rigs: Iterable[PicturedRig]) -> float:
    """Return the longest side of the region of the poles of rigs, metres."""
    at = np.array([mount.position[:2] for rig in rigs for mount in rig.mounts])
    return max(float(np.ptp(at, axis=0).max()), _LEAST_SITE_M)


def _states(name: str, rig: PicturedRig) -> list[tuple[str, PicturedRig]]:
    """Return the rig as built, with its worst LiDAR dead and as detected, if known; by name."""
    dead = None if rig.ground is None else rig.ground.dead
    states = [(name, rig)]
    if dead is not None:
        states.append((f"{name}, LiDAR {dead + 1} dead", replace(rig, dead=dead)))
    if rig.ground is not None and rig.detected is not None:
        states.append((f"{name}, as detected", replace(rig, ground=None)))
    return states


def _points(trace: go.Scatter3d | go.Surface) -> NDArray[np.float64]:
    """Return the points of a trace, shape (n, 3)."""
    if trace.type == "surface":
        x, y = np.meshgrid(trace.x, trace.y)
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return np.stack([trace.x, trace.y, trace.z], axis=1).astype(np.float64)


def _camera(scene: Mapping[str, Any], vehicle: Vehicle | None, distance: float) -> dict[str, Any]:
    """Place the camera in front of the left side of the vehicle, and let it look at its middle."""
    ranges = np.array([scene[f"{axis}axis"]["range"] for axis in "xyz"])
    scale = _LONGEST / np.ptp(ranges, axis=1).max()
    centre = scale * (extent_of(vehicle).mean(axis=0) - ranges.mean(axis=1))
    eye = centre + scale * distance * _EYE
    return {
        name: dict(zip("xyz", place.tolist(), strict=True))
        for name, place in (("eye", eye), ("center", centre))
    }


def _colours(grounds: Iterable[RecallGround | None]) -> dict[str, Any]:
    """Make the colours of grounds; a fiftieth of the cells may have less than the darkest."""
    maps = [values for ground in grounds if ground for values in (ground.built, ground.degraded)]
    low = min((float(np.nanquantile(values, 0.02)) for values in maps), default=0.0)
    high = max((float(np.nanmax(values)) for values in maps), default=1.0)
    ink = {"font": {"color": _INK}, "text": "recall"}
    bar = {"title": ink, "tickformat": ".0%", "thickness": 10, "len": 0.6, "x": 1}
    bar |= {"bgcolor": "rgba(255, 255, 255, 0.7)", "tickfont": {"color": _INK}}
    return {
        "colorscale": _GROUND,
        "cmin": np.floor(20 * low) / 20,
        "cmax": np.ceil(20 * high) / 20,
        "colorbar": bar | {"xanchor": "right", "nticks": 6},
    }


def _add_zones(plot: go.Figure, zones: Sequence[Zone]) -> None:
    lines = np.concatenate([_prism(zone) for zone in zones])
    add_lines(plot, lines, "#CC79A7", 4, name="zones")
    middles = np.array([np.mean(zone.polygon, axis=0) for zone in zones])
    plot.add_scatter3d(
        x=middles[:, 0],
        y=middles[:, 1],
        z=[zone.z[1] for zone in zones],
        mode="markers",
        marker={"size": 3, "color": "#CC79A7"},
        hovertext=[f"zone {text(zone.name)}" for zone in zones],
        **TOLD,
    )


def _add_rings(plot: go.Figure, vehicle: Vehicle | None, far: bool) -> None:
    """Draw rings around the middle of the vehicle on the ground, labelled with their radii.

    `far`: over the whole coloured ground, else near the vehicle."""
    (x0, y0, _), (x1, y1, _) = extent_of(vehicle)
    x, y, reach = (x0 + x1) / 2, (y0 + y1) / 2, np.hypot(x1 - x0, y1 - y0) / 2
    step = next(step for step in (1, 2, 5, 10) if reach <= 4 * step or step == 10)
    radii = np.arange(step, reach + step, step)
    radii = np.arange(10.0, REACH_M + 1, 10.0) if far else radii[radii > (y1 - y0) / 2 + 0.5]
    if not len(radii):  # no body, or none with a part in view
        return
    turn = np.linspace(0, 2 * np.pi, 73)
    unit = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    gap = np.full((1, 3), np.nan)
    rings = [part for radius in radii for part in (radius * unit + [x, y, 0.0], gap)]
    dash = None if has_body(vehicle) else "dot"  # lanes are lines, too
    add_lines(plot, np.concatenate(rings), OUTLINE, 1, showlegend=False, line_dash=dash)
    plot.add_scatter3d(
        x=np.full(len(radii), x),
        y=y + radii,
        z=np.zeros(len(radii)),
        mode="text",
        text=[f"{radius:g} m" for radius in radii],
        textfont={"size": 10, "color": OUTLINE},
        **QUIET,
    )


def _prism(zone: Zone) -> NDArray[np.float64]:
    """Draw both rings of a zone and the edges between them, broken by NaN; shape (n, 3)."""
    ring = np.array([*zone.polygon, zone.polygon[0]])
    gap = np.full((1, 3), np.nan)
    rings = [np.column_stack([ring, np.full(len(ring), z)]) for z in zone.z]
    upright = np.stack([rings[0], rings[1], np.full_like(rings[0], np.nan)], axis=1)
    return np.concatenate([rings[0], gap, rings[1], gap, upright.reshape(-1, 3)])


def _add_rig(plot: go.Figure, rig: PicturedRig, vehicle: Vehicle | None, gap: float) -> None:
    """Draw a rig: its posts, axes, and LiDARs with numbers `gap` metres apart."""
    carried = posts(rig.mounts, vehicle)
    if len(carried):
        add_lines(plot, carried, OUTLINE, 8, name="posts")
    at = np.array([mount.position for mount in rig.mounts])
    length = _AXIS_LENGTHS[has_body(vehicle)]
    for axis, (name, shade) in enumerate(_AXES):
        tips = length * np.array([mount.rotation[:, axis] for mount in rig.mounts])
        add_lines(plot, _pairs(at, at + tips), shade, 6, name=f"sensor's {name}", legendgroup=name)
    models = rig.models
    markers = lidar_markers(len(at), 7)
    if rig.dead is not None:
        markers["color"][rig.dead] = OUTLINE
    same = (
        f"LiDAR: {models[0]}"
        if len(set(models)) == 1 and models[0] not in ("", UNNAMED)
        else "LiDAR"
    )
    plot.add_scatter3d(
        **xyz(at),
        mode="markers",
        marker=markers,
        hovertext=[_words(rig, i) for i in range(len(at))],
        name=same,
        **TOLD | {"showlegend": same != "LiDAR"},
    )
    mixed = len(set(models)) > 1
    width = max(map(len, models)) / 2 + 1 if mixed else 1.0
    places = label_places(at, gap, width, in_front=has_body(vehicle))
    add_lines(plot, _pairs(at, places), OUTLINE, 1, showlegend=False)
    ink = {} if rig.ground is None and rig.detected is None else {"color": _INK}
    numbers = [f"{i} {model}" if mixed else str(i) for i, model in enumerate(models, start=1)]
    if rig.dead is not None:
        numbers[rig.dead] += " dead"
    style = {"textfont": {"size": 13} | ink, "textposition": "top center"}
    plot.add_scatter3d(**xyz(places), mode="text", text=numbers, **style, **QUIET)


def _add_ground(
    plot: go.Figure, ground: RecallGround, degraded: bool, colours: Mapping[str, Any]
) -> None:
    """Colour the ground by expected recall; under the vehicle as next to it."""
    values = (ground.degraded if degraded else ground.built).copy()
    hidden, (rows, columns) = np.isnan(values), np.nonzero(~np.isnan(values))
    for row, column in np.argwhere(hidden):
        nearest = np.hypot(rows - row, columns - column).argmin()
        values[row, column] = values[rows[nearest], columns[nearest]]
    _add_cells(plot, ground, values, colours)


def _add_cells(
    plot: go.Figure, ground: RecallGround, values: NDArray[np.float64], colours: Mapping[str, Any]
) -> None:
    """Colour the cells of a ground by values, shape (nx, ny); where they are NaN is none."""
    cells = values.T.astype(np.float32)
    plot.add_surface(
        x=ground.x.astype(np.float32),
        y=ground.y.astype(np.float32),
        z=np.where(np.isnan(cells), np.nan, np.float32(-0.02)),
        surfacecolor=cells,
        **colours,
        opacity=0.85,
        lighting={"ambient": 1.0, "diffuse": 0.0, "specular": 0.0},
        hovertemplate="x %{x:.0f}, y %{y:.0f} m: %{surfacecolor:.0%}<extra></extra>",
        contours={axis: {"highlight": False} for axis in "xyz"},
        showlegend=False,
    )


def label_places(
    at: NDArray[np.float64], gap: float, width: float = 1.0, in_front: bool = True
) -> NDArray[np.float64]:
    """Place texts above LiDARs at `at`, shape (n, 3), metres, left and right of them in turn.

    As the camera sees them at first, no two are nearer to each other than `gap` metres, `width`
    times as far from left to right. They are `in_front` of all, or each in front of its LiDAR."""
    right = np.array([-_EYE[1], _EYE[0], 0.0]) / np.hypot(*_EYE[:2])
    axes = np.stack([right, np.cross(_EYE / np.linalg.norm(_EYE), right)])
    scale = np.array([1 / width, 1.0])
    # A hair apart in a circle: what is at one place in the image has somewhere to go.
    turn = np.arange(len(at)) * 2.4
    start = (
        scale * (at @ axes.T)
        + gap * np.stack([(-1.0) ** np.arange(len(at)), np.ones(len(at))], axis=1)
        + 0.01 * gap * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    )
    places = start.copy()
    for _ in range(200):
        apart = places[:, None] - places[None]
        distance = np.linalg.norm(apart, axis=2) + np.eye(len(at)) * 2 * gap
        lacking = np.clip(1.001 * gap - distance, 0.0, None)
        if not lacking.any():
            break
        places += ((0.5 * lacking / distance)[:, :, None] * apart).sum(axis=1)
    along = _EYE / np.linalg.norm(_EYE)
    # In front of all, which the vehicle does not hide, and in one plane, as of the perspective,
    # which would move texts away from LiDARs that are far apart.
    depth = ((at @ along).max(initial=0.0) if in_front else at @ along) + 3 * gap
    placed: NDArray[np.float64] = places / scale @ axes + np.outer(depth, along)
    return placed


def _pairs(starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a line from each start to its end, broken by NaN, shape (3 n, 3)."""
    return np.stack([starts, ends, np.full_like(starts, np.nan)], axis=1).reshape(-1, 3)


def _words(rig: PicturedRig, i: int) -> str:
    mount = rig.mounts[i]
    roll, pitch, yaw = np.degrees([mount.roll, mount.pitch, mount.yaw]) + 0.0
    words = f": {rig.words[i]}" if rig.words[i] else ""
    return (
        f"LiDAR {i + 1}{words}<br>x {mount.x:.3f}, y {mount.y:.3f}, z {mount.z:.3f} m<br>"
        f"roll {roll:.1f}°, pitch {pitch:.1f}°, yaw {yaw:.1f}°"
    )
