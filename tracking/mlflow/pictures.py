"""Pictures of a trial's run: its placement, and precision over recall."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lidarplace.base.metrics import METRICS
from lidarplace.files.atomic import replacing
from lidarplace.mounting.outline import closed_lines
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import rotation
from tracking.figures.kit.style import OUTLINE, colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110
_AXIS_M = 0.5


def draw_rig(
    path: Path,
    title: str,
    mounts: Sequence[Mount],
    lidars: Sequence[Lidar],
    vehicle: Vehicle | None,
) -> None:
    """Write a PNG of a rig from above, from the side and from behind.

    From above it shows where x of every sensor points, from the others the plane in which it
    turns. `vehicle` is None for a nominal car."""
    from matplotlib.patches import Polygon

    figure = _figure(9.0, 2.7)
    panels: list[tuple[str, int, int]] = [("above", 0, 1), ("the left", 0, 2), ("behind", 1, 2)]
    axes = figure.subplots(1, 3, gridspec_kw={"width_ratios": [5.6, 5.6, 3.0]})
    body = vehicle or Vehicle.car()
    for axis, (view, across, up) in zip(axes, panels, strict=True):
        for line in closed_lines(body, (across, up)):
            axis.add_patch(Polygon(line, facecolor=OUTLINE, alpha=0.25, edgecolor=OUTLINE))
        for i, mount in enumerate(mounts):
            at = np.array([mount.x, mount.y, mount.z])
            turn = rotation(mount.roll, mount.pitch, mount.yaw)
            directions = turn[:, :1] if up == 1 else turn[:, :2]
            for j, direction in enumerate((_AXIS_M * directions).T):
                begin = at if up == 1 else at - direction
                ends = np.stack([begin, at + direction])
                axis.plot(ends[:, across], ends[:, up], color=colour(i), lw=2 if j == 0 else 1)
            axis.plot(at[across], at[up], "o", color=colour(i), markeredgecolor="white")
        axis.set_title(f"from {view}", fontsize=9)
        axis.set_xlabel("xy"[across] + " (m)")
        axis.set_ylabel("xyz"[up] + " (m)")
        axis.set_aspect("equal")
        axis.margins(0.12)
        if across == 1:
            axis.invert_xaxis()  # y is to the left of who looks ahead
    kinds = {(lidar.beams, "rays of a pattern" if lidar.pattern else "beams") for lidar in lidars}
    beams = ", ".join(f"{number:,} {kind}" for number, kind in sorted(kinds))
    figure.suptitle(f"{title}: {len(mounts)} LiDARs, {beams}", fontsize=11)
    _save(figure, path)


def draw_pr_curves(path: Path, title: str, curves: pd.DataFrame) -> None:
    """Write a PNG of precision over recall, a panel a class.

    `curves` has class, metric, iou, recall, precision, percent."""
    classes = list(dict.fromkeys(curves["class"]))
    figure = _figure(max(3.4 * len(classes), 5.0), 3.6)
    for axis, name in zip(figure.subplots(1, len(classes), squeeze=False)[0], classes, strict=True):
        of_class = curves[curves["class"] == name].groupby(["metric", "iou"], sort=False)
        for i, ((metric, iou), curve) in enumerate(of_class):
            label = f"{METRICS[str(metric)].short} @ {iou:g}"
            style = "-" if str(metric).endswith("3D") else "--"
            axis.plot(curve["recall"], curve["precision"], style, color=colour(i), label=label)
        axis.set(xlim=(0, 100), ylim=(0, 102), xlabel="recall (%)", ylabel="precision (%)")
        axis.set_title(name, fontsize=10)
        axis.legend(fontsize=8)
    figure.suptitle(title, fontsize=11)
    _save(figure, path)


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure  # not pyplot, which would keep it and ask for a display

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Figure, path: Path) -> None:
    for axis in figure.axes:
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        figure.savefig(partial, format="png", dpi=_DPI)
