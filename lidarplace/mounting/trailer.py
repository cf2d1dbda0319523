"""A vehicle that bends: a tractor, and a trailer that turns about its hitch."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.vehicle import Vehicle

_SKY = 1e3
"""Height of the air above a trailer, metres: a LiDAR there would turn with it."""
FACES = np.array(
    [
        [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6],
    ]
)  # fmt: skip
"""Triangles of a box, counterclockwise from outside; corner i + 2 j + 4 k is along x, y and z."""


@dataclass(frozen=True, eq=False)
class BendingVehicle(Vehicle):
    """A vehicle that bends; as a `Vehicle` it is straight, and `poses` has it at each angle.

    Attributes:
        trailer: number of boxes that turn, the first ones.
        hitch: x and y of the axis about which they do, metres.
        angles: how far, degrees counter-clockwise as seen from above: at 60 the end is on the
            right."""

    trailer: int = 0
    hitch: tuple[float, float] = (0.0, 0.0)
    angles: tuple[float, ...] = ()

    @cached_property
    def poses(self) -> Mapping[str, Vehicle]:
        """The vehicle by name of the case: straight, "", and at each angle of the trailer."""
        poses: dict[str, Vehicle] = {"": Vehicle(self.name, self.boxes, self.mesh)}
        for angle in self.angles:
            if angle:
                label = f"trailer at {angle:g}°".replace("-", "−")
                poses[label] = Vehicle(self.name, self.boxes[self.trailer :], self._bent(angle))
        return poses

    @property
    def no_mounts(self) -> NDArray[np.float64]:
        """The boxes in which no LiDAR may sit: those with volume, and all swept the trailer."""
        swept = self.boxes[: self.trailer].copy()
        swept[:, 1, 2] = _SKY
        return np.concatenate([self.interior, swept])

    def _bent(self, degrees: float) -> Mesh:
        """The turned boxes of the trailer as a surface, with the mesh of the vehicle."""
        angle, hitch = math.radians(degrees), np.array(self.hitch)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        sides = self.boxes[: self.trailer].transpose(0, 2, 1).tolist()
        corners = np.array([(x, y, z) for xs, ys, zs in sides for z in zs for y in ys for x in xs])
        corners[:, :2] = (corners[:, :2] - hitch) @ turn.T + hitch
        faces = (8 * np.arange(self.trailer)[:, None, None] + FACES).reshape(-1, 3)
        if self.mesh is None:
            return Mesh(corners, faces)
        return Mesh(
            np.concatenate([self.mesh.vertices, corners]),
            np.concatenate([self.mesh.faces, len(self.mesh.vertices) + faces]),
        )
