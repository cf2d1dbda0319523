"""The range in which a detector looks: its frame, and whole cells of its grids."""

from __future__ import annotations

import math

from training.detectors.detector import PointRange


def in_model_frame(point_range: PointRange, sensor_height: float) -> PointRange:
    """A range of the ego frame in a frame whose origin is `sensor_height` above the ground."""
    x0, y0, z0, x1, y1, z1 = point_range
    return x0, y0, z0 - sensor_height, x1, y1, z1 - sensor_height


def grown_to_cells(point_range: PointRange, cell: float) -> PointRange:
    """The range with its far ends in x and y moved out to a multiple of `cell`, metres."""
    x0, y0, z0, x1, y1, z1 = point_range
    # A range that fits up to rounding must not gain a cell.
    nx, ny = (math.ceil((high - low) / cell - 1e-6) for low, high in ((x0, x1), (y0, y1)))
    return x0, y0, z0, x0 + nx * cell, y0 + ny * cell, z1
