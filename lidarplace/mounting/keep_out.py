"""Boxes on a vehicle that hide objects and contain no LiDAR, but are no part of its body."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle, no_mounts_of, poses_of


@dataclass(frozen=True, eq=False)
class EquippedVehicle(Vehicle):
    """A vehicle with keep-outs, the last of its boxes. Areas are measured from its `body`, which is
    without them: so keep-outs move none."""

    body: Vehicle = field(kw_only=True)

    @cached_property
    def poses(self) -> Mapping[str, Vehicle]:
        """Shapes of the body, each with the keep-outs, by the name of the case."""
        keep_outs, poses = self.boxes[len(self.body.boxes) :], poses_of(self.body).items()
        return {label: pose.with_boxes(keep_outs) for label, pose in poses}

    @property
    def no_mounts(self) -> NDArray[np.float64]:
        """The boxes in which no LiDAR may sit."""
        return np.concatenate([no_mounts_of(self.body), self.interior])


def with_keep_outs(body: Vehicle, boxes: NDArray[np.float64]) -> Vehicle:
    """The vehicle with keep-outs, shape (n, 2, 3), metres."""
    if not len(boxes):
        return body
    every = np.concatenate([body.boxes, boxes])
    return EquippedVehicle(body.name, every, body.mesh, body=body)
