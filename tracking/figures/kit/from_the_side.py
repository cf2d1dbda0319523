"""The vehicle seen from its right side."""

from __future__ import annotations

import plotly.graph_objects as go

from tracking.figures.kit.style import VEHICLE, VEHICLE_OUTLINE

VEHICLE_HEIGHT = 1.5
"""Of the outline, metres."""


def vehicle_from_the_side() -> go.Scatter:
    """Outline of the vehicle, its nose to the right."""
    half = VEHICLE[0] / 2
    return go.Scatter(
        x=[-half, -half, -half + 0.3, 0.4, 1.1, half, half, -half],
        y=[0, 0.9, VEHICLE_HEIGHT, VEHICLE_HEIGHT, 0.9, 0.8, 0, 0],
        **VEHICLE_OUTLINE,
    )
