"""Vehicle, zones and the LiDARs of a rig as an interactive 3D picture; a menu chooses the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from lidarplace.viewing.axes import equal_axes, xyz
from tracking.figures.kit.style import OUTLINE, QUIET, TOLD, add_menu, figure, lidar_markers, text
from tracking.figures.kit.vehicle_lines import add_lines, extent_of, posts, vehicle_in_space
from tracking.run_folders.search_json import Zone

_AXES = (("x", "#D55E00"), ("y", "#009E73"), ("z", "#0072B2"))
"""Axes of a sensor, in colours that colour-blind readers can distinguish."""
_AXIS_LENGTH = 0.3  # metres
AXES_AND_POSTS = (
    "Drag to turn. Lines at a LiDAR are the sensor's axes, 0.3 m long; grey posts are the rack "
    "that LiDARs above the body need."
)
_CAMERA = {"eye": {"x": 1.5, "y": 1.35, "z": 0.7}, "center": {"x": 0.0, "y": 0.0, "z": -0.15}}


@dataclass(frozen=True)
class PicturedRig:
    """Mounts, and plotly text of each next to its pose, such as its LiDAR model; may be empty."""

    mounts: tuple[Mount, ...]
    words: tuple[str, ...]

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


def rig_picture(
    rigs: Mapping[str, PicturedRig], vehicle: Vehicle | None, zones: Sequence[Zone] = ()
) -> go.Figure:
    """Draw rigs by their names in a menu, the first one at the start.

    A sedan carries them for a `vehicle` of None; LiDARs may sit in `zones`."""
    plot = figure("LiDARs on the vehicle", height=420, margin={"l": 0, "r": 0, "t": 70, "b": 32})
    plot.add_traces(vehicle_in_space(vehicle))
    _add_ground(plot, vehicle)
    if zones:
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
    owner = [""] * len(plot.data)
    first = next(iter(rigs))
    for name, rig in rigs.items():
        before = len(plot.data)
        _add_rig(plot, rig, vehicle)
        owner += [name] * (len(plot.data) - before)
    for trace, rig_name in zip(plot.data, owner, strict=True):
        trace.visible = rig_name in ("", first)
    # Axes of equal scale that hold every rig, so that the menu does not move the picture.
    seen = [np.stack([trace.x, trace.y, trace.z], 1).astype(np.float64) for trace in plot.data]
    scene = equal_axes(np.concatenate(seen), longest=1.9)
    for axis in "xyz":  # the rings on the ground are the scale
        scene[f"{axis}axis"]["visible"] = False
    plot.update_layout(
        scene=scene | {"camera": _CAMERA, "dragmode": "turntable"},
        legend={"orientation": "h", "y": 0, "yanchor": "top", "itemsizing": "constant"},
    )
    changes = [({"visible": [rig_name in ("", name) for rig_name in owner]},) for name in rigs]
    return add_menu(plot, [text(name) for name in rigs], changes, y=1)


def _add_ground(plot: go.Figure, vehicle: Vehicle | None) -> None:
    """Draw rings around the middle of the vehicle on the ground, labelled with their radii."""
    (x0, y0, _), (x1, y1, _) = extent_of(vehicle)
    x, y, reach = (x0 + x1) / 2, (y0 + y1) / 2, np.hypot(x1 - x0, y1 - y0) / 2
    step = next(step for step in (1, 2, 5, 10) if reach <= 4 * step or step == 10)
    radii = np.arange(step, reach + step, step)
    radii = radii[radii > (y1 - y0) / 2 + 0.5]  # of which a part is in view
    if not len(radii):  # no body
        return
    turn = np.linspace(0, 2 * np.pi, 73)
    unit = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    gap = np.full((1, 3), np.nan)
    rings = [part for radius in radii for part in (radius * unit + [x, y, 0.0], gap)]
    add_lines(plot, np.concatenate(rings), OUTLINE, 1, showlegend=False)
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


def _add_rig(plot: go.Figure, rig: PicturedRig, vehicle: Vehicle | None) -> None:
    carried = posts(rig.mounts, vehicle)
    if len(carried):
        add_lines(plot, carried, OUTLINE, 8, name="posts")
    at = np.array([mount.position for mount in rig.mounts])
    for axis, (name, shade) in enumerate(_AXES):
        ends = at + _AXIS_LENGTH * np.array([mount.rotation[:, axis] for mount in rig.mounts])
        lines = np.stack([at, ends, np.full_like(at, np.nan)], axis=1).reshape(-1, 3)
        add_lines(plot, lines, shade, 6, name=f"sensor's {name}", legendgroup=name)
    plot.add_scatter3d(
        **xyz(at),
        mode="markers+text",
        marker=lidar_markers(len(at), 7),
        text=[str(number) for number in range(1, len(at) + 1)],
        textposition="middle right",
        hovertext=[_words(rig, i) for i in range(len(at))],
        name="LiDAR",
        **TOLD,
    )


def _words(rig: PicturedRig, i: int) -> str:
    mount = rig.mounts[i]
    roll, pitch, yaw = np.degrees([mount.roll, mount.pitch, mount.yaw]) + 0.0
    words = f": {rig.words[i]}" if rig.words[i] else ""
    return (
        f"LiDAR {i + 1}{words}<br>x {mount.x:.3f}, y {mount.y:.3f}, z {mount.z:.3f} m<br>"
        f"roll {roll:.1f}°, pitch {pitch:.1f}°, yaw {yaw:.1f}°"
    )
