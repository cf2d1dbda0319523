"""Figures of public classes, which the top of the package draws."""

from collections.abc import Callable
from typing import Any


class Plottable:
    """A public thing with a figure."""

    def plot(self) -> Any:
        """Return a plotly figure (`plotly.graph_objects.Figure`); a notebook draws it."""
        return _DRAW[-1](self)


_DRAW: list[Callable[[Any], Any]] = []


def draw_with(draw: Callable[[Any], Any]) -> None:
    """Register what draws figures: `lidarplace`, as drawing is above all that it draws."""
    _DRAW.append(draw)
