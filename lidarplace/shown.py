"""What shows itself: as a line where Python prints it, as a figure where somebody asks for it."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Shown:
    """A public thing with a figure in `lidarplace.viewing.figures`."""

    def plot(self) -> Any:
        """A plotly figure (`plotly.graph_objects.Figure`); a notebook draws it."""
        # Viewing stands above all that it shows, and brings plotly.
        return import_module("lidarplace.viewing.figures").figure(self)


def span(values: list[float]) -> str:
    """Where numbers lie, such as "2.2" or "-0.6 to 0.6"."""
    low, high = f"{min(values) + 0.0:.3g}", f"{max(values) + 0.0:.3g}"
    return low if low == high else f"{low} to {high}"
