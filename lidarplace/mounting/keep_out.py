"""Boxes on a vehicle that hide objects and contain no LiDAR, but are no part of its body."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle, no_mounts_of, poses_of


@dataclass(frozen=True, eq=False)
class EquippedVehicle(Vehicle):
    """A vehicle with keep-outs, the last of its boxes.

    Attributes:
        body: without them. Areas around the vehicle are measured from it, so keep-outs move none.
    """

    body: Vehicle | None = None

    @cached_property
    def _keep_outs(self) -> Vehicle:
        assert self.body is not None
        return Vehicle(self.name, self.boxes[len(self.body.boxes) :])

    @cached_property
    def poses(self) -> Mapping[str, Vehicle]:
        """All shapes of the body, with the keep-outs, by the name of the case."""
        assert self.body is not None
        poses = poses_of(self.body).items()
        return {label: pose.with_boxes(self._keep_outs.boxes) for label, pose in poses}

    @property
    def no_mounts(self) -> NDArray[np.float64]:
        """The boxes in which no LiDAR may sit."""
        assert self.body is not None
        return np.concatenate([no_mounts_of(self.body), self._keep_outs.interior])


def with_keep_outs(body: Vehicle, boxes: NDArray[np.float64]) -> Vehicle:
    """The vehicle with keep-outs, shape (n, 2, 3), metres."""
    if not len(boxes):
        return body
    return EquippedVehicle(body.name, np.concatenate([body.boxes, boxes]), body.mesh, body)
