"""A LiDAR on a vehicle as files of rigs have it: a name, a pose, and maybe a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import angles

Vector = tuple[float, float, float]
"""x, y, z in metres."""


@dataclass(frozen=True)
class MountedLidar:
    """One LiDAR of a rig.

    Attributes:
        name: in the file.
        mount: in the vehicle frame of whoever has it.
        model: None where the file tells none.
    """

    name: str
    mount: Mount
    model: SensorSettings | None = None

    def moved(self, x: float, y: float, z: float) -> MountedLidar:
        """The same LiDAR, farther by so many metres."""
        mount = self.mount
        # Rounded, as 1.9 - 0.3 would be written as 1.5999999999999999.
        x, y, z = (round(value, 12) for value in (mount.x + x, mount.y + y, mount.z + z))
        return replace(self, mount=replace(mount, x=x, y=y, z=z))


def mount_of(position: ArrayLike, matrix: NDArray[np.float64]) -> Mount:
    """A mount of a position, 3 metres, and a sensor-to-vehicle rotation, (3, 3)."""
    x, y, z = np.asarray(position, np.float64).tolist()
    return Mount(x, y, z, *angles(matrix))


def mount_at(position: Iterable[float], turned: Iterable[float], where: str) -> Mount:
    """A mount of metres and radians in a file. Raises ValueError that says `where`."""
    try:
        return Mount(*position, *turned)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def named_like(names: Sequence[str], patterns: Sequence[str], source: str) -> list[str]:
    """Those of the names that a pattern fits, whatever their case; all, without a pattern.

    `*` stands for any text. Raises ValueError if a pattern fits none of them.
    """
    if not patterns:
        return list(names)
    for pattern in patterns:
        if not any(fnmatchcase(name.lower(), pattern.lower()) for name in names):
            listed = ", ".join(names) or "none"
            raise ValueError(
                f"{source}: no LiDAR is called {pattern}; found {listed}; --only says which"
            )
    return [
        name
        for name in names
        if any(fnmatchcase(name.lower(), pattern.lower()) for pattern in patterns)
    ]


def check_lidars(lidars: Sequence[MountedLidar], source: str) -> None:
    """Raise ValueError if there is no LiDAR, or two have one name."""
    if not lidars:
        raise ValueError(f"{source}: no LiDAR")
    names = [lidar.name for lidar in lidars]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"{source}: two LiDARs are called {twice[0]}; names must differ")
