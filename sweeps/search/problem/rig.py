"""A rig that a search looks at: which LiDAR models sit where, in an order of its own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, replace

from lidarplace import Lidar, Mount, Placement


@dataclass(frozen=True, order=True)
class Mounted:
    """One LiDAR of a rig.

    Attributes:
        model: name of its model.
        zone: name of the zone in which it sits; empty if it is fixed.
        mount: its pose, rounded if it was searched for.
    """

    model: str
    zone: str
    mount: Mount


@dataclass(frozen=True)
class Rig:
    """LiDARs in a canonical order: rigs that differ in the order of their LiDARs are equal."""

    lidars: tuple[Mounted, ...]

    @classmethod
    def of(cls, lidars: Iterable[Mounted]) -> Rig:
        """The rig of these LiDARs, in whatever order."""
        return cls(tuple(sorted(lidars, key=lambda m: (m.model, m.zone, astuple(m.mount)))))

    def placement(self, name: str, models: Mapping[str, Lidar]) -> Placement:
        """The placement. Raises ValueError if two LiDARs sit in one place."""
        return Placement(
            name,
            [lidar.mount for lidar in self.lidars],
            lidar=[models[lidar.model] for lidar in self.lidars],
        )

    @property
    def possible(self) -> bool:
        """Whether no two LiDARs sit in one place."""
        places = {(m.mount.x, m.mount.y, m.mount.z) for m in self.lidars}
        return len(places) == len(self.lidars)

    def price(self, prices: Mapping[str, float]) -> float:
        """Of all LiDARs."""
        return math.fsum(prices[lidar.model] for lidar in self.lidars)


def rounded(mount: Mount) -> Mount:
    """To the millimetre and a ten-thousandth of a radian: no one mounts more exactly, and the files
    that people read have short numbers."""
    x, y, z, *angles = astuple(mount)
    # + 0.0: no negative zero.
    lengths = [round(value, 3) + 0.0 for value in (x, y, z)]
    return Mount(*lengths, *(round(angle, 4) + 0.0 for angle in angles))


def mirrored(mount: Mount) -> Mount:
    """On the other side of the vehicle: left and right exchanged."""
    # 0 - v, not -v: a zero stays +0, so that equal rigs are equal.
    return replace(mount, y=0 - mount.y, roll=0 - mount.roll, yaw=0 - mount.yaw)
