"""Errors of mounts that are not where they were meant to be, the same for all rigs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import angles


@dataclass(frozen=True)
class MountingErrors:
    """Limits of an offset and of a rotation vector w, `exp(w) R` for a mount's rotation R.

    Both are in the ego frame; their components are uniform and independent. So the angles spread
    alike about every axis, also where pitch is ±90°.

    Attributes:
        offset: metres at most, along each axis; finite, not negative.
        angle: radians at most, each component of the rotation vector; finite, not negative."""

    offset: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.offset < math.inf and 0 <= self.angle < math.inf):
            raise InputError("offset and angle must be finite and at least 0", found=self)

    def __bool__(self) -> bool:
        return self.offset > 0 or self.angle > 0

    def drawn(self, placement: Placement, *key: int) -> Placement:
        """Draw the rig as one vehicle has it, which `key` identifies, such as a seed and a frame.

        In one vehicle the i-th LiDAR of every rig is off by the same: differences are paired."""
        every = [*placement.mounts, *(mount for mount, _ in placement.dead)]
        off = [self._moved(m, *_error(self, *key, n)) for n, m in enumerate(every)]
        working = len(placement.mounts)
        dead = zip(off[working:], (lidar for _, lidar in placement.dead), strict=True)
        return replace(placement, mounts=off[:working], dead=tuple(dead))

    def displaced(self, mount: Mount, random: np.random.Generator) -> Mount:
        """Draw the mount with an error; its angles are those of the turned rotation."""
        return self._moved(mount, *_draw(self, random))

    def _moved(self, mount: Mount, shift: Sequence[float], turn: NDArray[np.float64]) -> Mount:
        roll, pitch, yaw = mount.roll, mount.pitch, mount.yaw
        if self.angle:  # without it the angles stay: others may mean the same rotation
            roll, pitch, yaw = angles(turn @ _rotation(mount))
        return Mount(mount.x + shift[0], mount.y + shift[1], mount.z + shift[2], roll, pitch, yaw)


@lru_cache(maxsize=64)
def _rotation(mount: Mount) -> NDArray[np.float64]:
    return mount.rotation


@lru_cache(maxsize=1 << 15)
def _error(errors: MountingErrors, *key: int) -> tuple[list[float], NDArray[np.float64]]:
    """Return the error of one LiDAR of a vehicle, which all rigs share."""
    return _draw(errors, np.random.default_rng(key))


def _draw(
    errors: MountingErrors, random: np.random.Generator
) -> tuple[list[float], NDArray[np.float64]]:
    """Draw an offset, metres, and a rotation."""
    shift, turn = random.uniform(-1, 1, (2, 3)) * [[errors.offset], [errors.angle]]
    return shift.tolist(), Rotation.from_rotvec(turn).as_matrix()


def fleet(
    placement: Placement, errors: MountingErrors, number: int, seed: int
) -> tuple[Placement, ...]:
    """Draw the rig as `number` vehicles have it; the rig itself if `number` is 0."""
    drawn = (errors.drawn(placement, seed, vehicle) for vehicle in range(1, number + 1))
    return tuple(drawn) or (placement,)
