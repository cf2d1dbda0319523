"""Labels of tasks and trials."""

from collections.abc import Collection, Mapping
from typing import Any

from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.configuration.point import Point

_IDENTITY = ("placement", "detector", "seed")


def task_label(grid_point: GridPoint, keys: Collection[str], *names: str) -> str:
    """Return the placement and the axes that `keys` of the configuration decide, then `names`.

    Where neither is decided it begins with the scene."""
    parts = [grid_point.point.placement] if "placement" in keys else []
    parts += [
        f"{axis}={value}"
        for axis, value in grid_point.axes.items()
        if axis != "placement" and any(_is_inside(axis, k) or _is_inside(k, axis) for k in keys)
    ]
    return " · ".join([*(parts or [grid_point.point.scene.name]), *filter(None, names)])


def _is_inside(key_path: str, other: str) -> bool:
    return f"{key_path}.".startswith(f"{other}.")


def trial_label(point: Point, axes: Mapping[str, Any]) -> str:
    """Return the placement, detector, seed and the further axes of a point."""
    further = [f"{axis}={axes[axis]}" for axis in axes if axis not in _IDENTITY]
    detector = point.detector_name
    detected = [detector, f"seed {point.seed}"] if detector else []
    return " · ".join([point.placement, *detected, *further])


def further_axes(sweep: Sweep) -> tuple[str, ...]:
    """List the axes of the grid besides placement, detector and seed."""
    return tuple(axis for axis in sweep.axes if axis not in _IDENTITY)
