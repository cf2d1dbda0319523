"""What tasks and trials are called: the placement, and the axes of the grid that matter to them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from sweeps.configuration.grid import GridPoint
from sweeps.configuration.sweep import Point


def task_label(grid_point: GridPoint, keys: Collection[str], *names: str) -> str:
    """The placement and the axes among `keys` of the configuration, or the scene; then `names`."""
    parts = [grid_point.point.placement] if "placement" in keys else []
    parts += [
        f"{axis}={value}"
        for axis, value in grid_point.axes.items()
        if axis != "placement" and any(_overlap(axis, key) for key in keys)
    ]
    return " · ".join([*(parts or [grid_point.point.scene.name]), *filter(None, names)])


def _overlap(one: str, other: str) -> bool:
    """Whether a key path is the other, or above or below it."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def trial_label(point: Point, axes: Mapping[str, Any]) -> str:
    """The placement, detector, seed and the further axes of a point."""
    further = [
        f"{axis}={value}"
        for axis, value in axes.items()
        if axis not in ("placement", "detector", "seed")
    ]
    detected = [point.detector, f"seed {point.seed}"] if point.detector else []
    return " · ".join([point.placement, *detected, *further])
