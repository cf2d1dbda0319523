"""Other conventions that boxes may be in: axes, yaw and frame of coordinates."""

import math
from dataclasses import dataclass
from typing import Literal

from lidarplace.logs.convention import OUR_AXES, Axis, Convention, Sense, Zero


@dataclass(frozen=True)
class Alternative:
    """A convention that the numbers of a log may be in, which is not ours."""

    meaning: str
    remedy: str
    convention: Convention
    place: Literal["ego", "axes", "world"] = "ego"
    """Frame of x and y: the vehicle's; axes of the world at the vehicle; the world's."""
    yaw: Literal["ego", "world"] = "ego"
    turned: bool = False  # whether the factor is of the yaw in the world

    @property
    def is_mapped(self) -> bool:
        """Whether `convention` says all of it."""
        return self.place == self.yaw == "ego" and not self.turned


def _alternative(
    meaning: str,
    axes: tuple[Axis, Axis, Axis] = OUR_AXES,
    zero: Zero = "x",
    sense: Sense = "counterclockwise",
    radians: float = 1.0,
    turned: bool = False,
) -> Alternative:
    convention = Convention.of(axes, zero, sense, radians)
    keys = "yaw and axes" if radians == 1.0 else "units.angle"
    return Alternative(meaning, f"{keys} ({meaning})", convention, turned=turned)


_WORLD = "coordinates (world, with poses)"
_MIRRORED: tuple[Axis, Axis, Axis] = ("forward", "right", "up")
_SWAPPED: tuple[Axis, Axis, Axis] = ("left", "forward", "up")
_Y_AHEAD: tuple[Axis, Axis, Axis] = ("right", "forward", "up")
OURS = Alternative("", "", Convention())
CLOCKWISE = _alternative("yaw clockwise", sense="clockwise")
SEEN_FROM_THE_VEHICLE = (
    _alternative("yaw in deg", radians=math.pi / 180),
    _alternative("yaw in rad", radians=180 / math.pi),
    CLOCKWISE,
    _alternative("yaw from the y axis", zero="y"),
    _alternative("yaw clockwise from the y axis", zero="y", sense="clockwise"),
    _alternative("y to the right", _MIRRORED),
    _alternative("x and y swapped", _SWAPPED, "y"),
    _alternative("y ahead, x to the right", _Y_AHEAD, "y"),
    _alternative("y ahead, x to the right and yaw from x", _Y_AHEAD),
)
SEEN_IN_THE_WORLD = (
    *SEEN_FROM_THE_VEHICLE,
    _alternative("yaw in deg", radians=math.pi / 180, turned=True),
    _alternative("yaw in rad", radians=180 / math.pi, turned=True),
    _alternative("yaw clockwise", sense="clockwise", turned=True),
    _alternative("y to the right and yaw clockwise", _MIRRORED, sense="clockwise"),
    _alternative("x and y swapped and yaw from y", _SWAPPED, sense="clockwise"),
    _alternative("x back", ("back", "left", "up"), "-x"),
    _alternative("x back and y to the right", ("back", "right", "up"), "-x"),
    Alternative("yaw of the world", _WORLD, Convention(), yaw="world"),
    Alternative("axes of the world", _WORLD, Convention(), place="axes", yaw="world"),
    Alternative("coordinates of the world", _WORLD, Convention(), place="world", yaw="world"),
    Alternative("x and y of the world", _WORLD, Convention(), place="world"),
)
"""Conventions that show if poses of the vehicle are known."""
