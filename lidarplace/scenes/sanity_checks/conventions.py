"""Other conventions that boxes may be in: axes, yaw and frame of coordinates."""

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Convention:
    """Conversion of the numbers of a log to the ego frame, if they are in another convention."""

    meaning: str
    remedy: str  # keys of a mapping
    axes: tuple[float, float, float, float] = (1, 0, 0, 1)  # rows of the matrix of x and y
    factor: float = 1.0  # of yaw
    turn: float = 0.0  # added to yaw
    place: Literal["ego", "axes", "world"] = "ego"
    """Frame of x and y: the vehicle's; axes of the world at the vehicle; the world's."""
    yaw: Literal["ego", "world"] = "ego"
    turned: bool = False  # whether the factor is of the yaw in the world


_YAW = "columns.yaw (counter-clockwise from the x axis)"
_XY = "columns.x and columns.y (ahead, to the left)"
_WORLD = "coordinates (world, with poses)"
_QUARTER = math.pi / 2
OURS = Convention("", "")
CLOCKWISE = Convention("yaw clockwise", _YAW, factor=-1)
SEEN_FROM_THE_VEHICLE = (
    Convention("yaw in deg", "units.angle: deg", factor=math.pi / 180),
    Convention("yaw in rad", "units.angle: rad", factor=180 / math.pi),
    CLOCKWISE,
    Convention("yaw from the y axis", _YAW, turn=_QUARTER),
    Convention("yaw clockwise from the y axis", _YAW, factor=-1, turn=_QUARTER),
    Convention("y to the right", _XY, (1, 0, 0, -1)),
    Convention("x and y swapped", _XY, (0, 1, 1, 0)),
    Convention("y ahead, x to the right", _XY, (0, 1, -1, 0)),
    Convention("y ahead, x to the right and yaw from x", _XY, (0, 1, -1, 0), turn=-_QUARTER),
)
SEEN_IN_THE_WORLD = (
    *SEEN_FROM_THE_VEHICLE,
    Convention("yaw in deg", "units.angle: deg", factor=math.pi / 180, turned=True),
    Convention("yaw in rad", "units.angle: rad", factor=180 / math.pi, turned=True),
    Convention("yaw clockwise", _YAW, factor=-1, turned=True),
    Convention("y to the right and yaw clockwise", _XY, (1, 0, 0, -1), -1),
    Convention("x and y swapped and yaw from y", _XY, (0, 1, 1, 0), -1, _QUARTER),
    Convention("x back", _XY, (-1, 0, 0, 1)),
    Convention("x back and y to the right", _XY, (-1, 0, 0, -1)),
    Convention("yaw of the world", _WORLD, yaw="world"),
    Convention("axes of the world", _WORLD, place="axes", yaw="world"),
    Convention("coordinates of the world", _WORLD, place="world", yaw="world"),
    Convention("x and y of the world", _WORLD, place="world"),
)
"""Conventions that show if poses of the vehicle are known."""
