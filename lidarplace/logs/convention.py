"""Conventions of boxes: axes, yaw, sizes and reference point of a source, to ours and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError

Axis = Literal["forward", "back", "left", "right", "up", "down"]
Zero = Literal["x", "-x", "y", "-y", "z", "-z"]
Sense = Literal["counterclockwise", "clockwise"]
OUR_AXES: tuple[Axis, Axis, Axis] = ("forward", "left", "up")
CARLA_AXES: tuple[Axis, Axis, Axis] = ("forward", "right", "up")
_DIRECTIONS: dict[str, tuple[int, int, int]] = {
    "forward": (1, 0, 0),
    "back": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
"""Directions in our axes."""
_ZEROS = dict(zip(get_args(Zero), _DIRECTIONS.values(), strict=True))
ANCHORS = {"rear": 0, "front": 0, "right": 1, "left": 1, "bottom": 2, "top": 2, "centre": -1}
"""Words of a reference point of a box, and the box's axis that each is an end of."""


@dataclass(frozen=True)
class Convention:
    """Meaning of seven numbers of a box: centre, length, width, height, yaw.

    Conventions of box logs are the defaults. `factor` and `turn` are linear, so that a yaw of
    many turns stays one."""

    axes: tuple[Axis, Axis, Axis] = OUR_AXES  # directions of the source's x, y and z
    factor: float = 1.0  # radians, counter-clockwise from above, of a unit of yaw
    turn: float = 0.0  # yaw in our axes of a box of yaw 0, radians
    metres: float = 1.0  # of a unit of position
    size: float = 1.0  # metres of a unit of size; twice that of half sizes
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Reference point of a box: share of length, width and height, from the centre."""

    @classmethod
    def of(
        cls,
        axes: tuple[Axis, Axis, Axis] = OUR_AXES,
        zero: Zero = "x",
        sense: Sense | None = None,
        radians: float = 1.0,
    ) -> Self:
        """Return the convention of these axes, and of a yaw in units of `radians`.

        At yaw 0 the front points along `zero`, an axis of the source. Without `sense` yaw is a
        rotation about the source's vertical axis: from x to y about z. Raises ValueError for axes
        that are not at right angles, or a `zero` that is not level."""
        matrix = np.array([_DIRECTIONS[axis] for axis in axes], np.float64).T
        if abs(np.linalg.det(matrix)) != 1:
            expected = "one axis along the vehicle, one across, one upright"
            raise InputError(key="axes", expected=expected, found=", ".join(axes))
        front = matrix @ np.array(_ZEROS[zero], np.float64)
        if front[2] != 0:
            raise InputError(key="yaw.zero", expected="a level axis", found=zero)
        about = np.linalg.det(matrix) * matrix[2].sum()
        sign = about if sense is None else 1.0 if sense == "counterclockwise" else -1.0
        return cls(axes, float(sign) * radians, math.atan2(front[1], front[0]))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Matrix from the source's axes to ours, (3, 3)."""
        return np.array([_DIRECTIONS[axis] for axis in self.axes], np.float64).T

    @property
    def zero(self) -> Zero:
        """Axis of the source along which the front of a box of yaw 0 points."""
        front = self.matrix.T @ [math.cos(self.turn), math.sin(self.turn), 0.0]
        return max(get_args(Zero), key=lambda zero: float(np.dot(_ZEROS[zero], front)))

    @property
    def sense(self) -> Sense:
        """Sense of yaw, seen from above."""
        return "counterclockwise" if self.factor > 0 else "clockwise"

    def after(self, first: Convention) -> Convention:
        """Return the convention of numbers that `first`, and then this one, converts to ours."""
        names = dict(zip(_DIRECTIONS.values(), get_args(Axis), strict=True))
        x, y, z = (tuple(column) for column in (self.matrix @ first.matrix).astype(int).T.tolist())
        return replace(
            first,
            axes=(names[x], names[y], names[z]),
            factor=self.factor * first.factor,
            turn=math.remainder(self.turn + self.factor * first.turn, 2 * math.pi),
            metres=self.metres * first.metres,
            size=self.size * first.size,
        )

    def places(self, places: ArrayLike) -> NDArray[np.float64]:
        """Convert points or poses' positions, (n, 3), to our axes and metres."""
        return np.asarray(places, np.float64) @ (self.matrix.T * self.metres)

    def turns(self, matrices: ArrayLike) -> NDArray[np.float64]:
        """Convert rotations between frames of the source's axes, (n, 3, 3), to ours."""
        return np.asarray(self.matrix @ np.asarray(matrices, np.float64) @ self.matrix.T)

    def yaws(self, values: ArrayLike) -> NDArray[np.float64]:
        """Convert yaws to ours, radians."""
        return self.turn + self.factor * np.asarray(values, np.float64)

    def yaws_of(self, matrices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return yaws of rotations in the source's axes, (n, 3, 3); radians in (-pi, pi]."""
        return self.yaws_along(matrices @ np.array(_ZEROS[self.zero], np.float64))

    def yaws_along(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return yaws of boxes whose fronts point along directions in the source's axes, (n, 3)."""
        x, y, _ = (directions @ self.matrix.T).T
        return np.asarray(np.arctan2(y, x))

    def boxes(
        self, places: ArrayLike, sizes: ArrayLike, yaws: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return boxes as rows of `GEOMETRY`, (n, 7).

        Args:
            places: of the reference points in the source, (n, 3).
            sizes: in the source, (n, 3).
            yaws: ours, (n,)."""
        sizes = np.asarray(sizes, np.float64) * self.size
        return np.column_stack([self.places(places) - self._offsets(sizes, yaws), sizes, yaws])

    def written(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return our boxes, (n, 7), as numbers of the source: the inverse of `yaws` and `boxes`."""
        sizes, yaws = boxes[:, 3:6], boxes[:, 6]
        places = (boxes[:, :3] + self._offsets(sizes, yaws)) @ self.matrix / self.metres
        return np.column_stack([places, sizes / self.size, (yaws - self.turn) / self.factor])

    def _offsets(
        self, sizes: NDArray[np.float64], yaws: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return reference points less centres in our axes, metres, (n, 3)."""
        ahead, aside, up = (sizes * self.anchor).T
        cos, sin = np.cos(yaws), np.sin(yaws)
        return np.stack([cos * ahead - sin * aside, sin * ahead + cos * aside, up], axis=1)


def anchor_of(words: str) -> tuple[float, float, float]:
    """Return the anchor of words such as "bottom" or "rear left bottom".

    Raises ValueError for others."""
    anchor = [0.0, 0.0, 0.0]
    used: set[int] = set()
    for word in words.split():
        axis = ANCHORS.get(word)
        if axis is None or axis in used:
            expected = "centre, or words such as bottom, top, front, rear left bottom"
            raise InputError(expected=expected, found=words)
        used.add(axis)
        if axis >= 0:
            anchor[axis] = -0.5 if word in ("rear", "right", "bottom") else 0.5
    if not used:
        raise InputError(expected="centre, bottom, or a corner such as rear left bottom", found="")
    return anchor[0], anchor[1], anchor[2]


def forward_axis(axes: tuple[Axis, Axis, Axis]) -> Zero:
    """Return the axis of a source that points ahead; "x" if none does."""
    along = next((n for n, axis in enumerate(axes) if axis in ("forward", "back")), 0)
    zero: Zero = get_args(Zero)[2 * along + (axes[along] == "back")]
    return zero
