"""The range in which a detector looks: its frame, and whole cells of its grids."""

import math
from collections.abc import Sequence

from training.detectors.detector import PointRange


def fitted_range(
    own: PointRange, sensor_height: float, wanted: PointRange | None, cell: Sequence[float] = ()
) -> PointRange:
    """The range of a network in its own frame, `sensor_height` above the ground.

    A network in a sensor's frame keeps its own heights: its weights fit one number of layers and
    points that are measured from that height.

    Args:
        own: range of its preset, in its frame, metres.
        sensor_height: 0 for a network that works in the ego frame.
        wanted: range in the ego frame that replaces the preset's.
        cell: edges of the coarsest cell along x, y and, for voxels, z; the far ends of the range
            move out to a whole number of them.
    """
    low, high = list(own[:3]), list(own[3:])
    if wanted is not None:
        axes = 3 if sensor_height == 0 else 2
        low[:axes], high[:axes] = wanted[:axes], wanted[3 : 3 + axes]
    for axis, edge in enumerate(cell):
        # A range that fits up to rounding must not gain a cell.
        high[axis] = low[axis] + math.ceil((high[axis] - low[axis]) / edge - 1e-6) * edge
    return low[0], low[1], low[2], high[0], high[1], high[2]
