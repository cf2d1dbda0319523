"""Mounts that are not where they were meant to be, the same for all rigs."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from lidarplace.placement import Mount, Placement


@dataclass(frozen=True)
class MountingErrors:
    """How far each LiDAR may be off, uniform and independent for every coordinate.

    Attributes:
        offset: metres, along each axis of the ego frame.
        angle: radians, of roll, pitch and yaw.

    Raises:
        ValueError: a value is negative or not finite.
    """

    offset: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.offset < math.inf and 0 <= self.angle < math.inf):
            raise ValueError(
                f"mounting errors need finite offset and angle of at least 0, found {self}"
            )

    def __bool__(self) -> bool:
        return self.offset > 0 or self.angle > 0

    def drawn(self, placement: Placement, *key: int) -> Placement:
        """The rig as one vehicle has it.

        Args:
            key: tells the vehicle, such as a seed and a frame. In one vehicle the i-th LiDAR of
                every rig is off by the same, so that differences between rigs are paired.
        """
        scale = np.repeat([self.offset, self.angle], 3)
        mounts = []
        every = [*placement.mounts, *(mount for mount, _ in placement.dead)]
        for number, mount in enumerate(every):
            shift = scale * np.random.default_rng((*key, number)).uniform(-1, 1, 6)
            mounts.append(Mount(*(np.array(astuple(mount)) + shift).tolist()))
        working = len(placement.mounts)
        models = [lidar for _, lidar in placement.dead]
        dead = tuple(zip(mounts[working:], models, strict=True))
        return replace(placement, mounts=mounts[:working], dead=dead)
