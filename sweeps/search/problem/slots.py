"""Slots of a rig: a LiDAR or a mirrored pair to mount, and what is mounted there."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from lidarplace.configuration.mounting import Pair
from lidarplace.mounting.zone import Zone
from sweeps.search.problem.rig import MountedLidar, Rig, mirrored, ordered

ANGLES = ("roll", "pitch", "yaw")
Spans = Mapping[str, Pair]
"""Lowest and highest roll, pitch and yaw, degrees, ego frame."""


@dataclass(frozen=True)
class MountSlot:
    """A LiDAR to place, or the left one of a mirrored pair.

    `name` is the prefix of its parameters, such as `lidar_1`; `spans` are by model."""

    name: str
    zones: tuple[Zone, ...]
    models: tuple[str, ...]
    spans: Mapping[str, Spans]
    pair: bool

    @property
    def size(self) -> int:
        """Number of LiDARs in the slot."""
        return 2 if self.pair else 1

    def common_span(self, angle: str) -> Pair | None:
        """Return the span of an angle if it is the same for all models."""
        spans = {self.spans[model][angle] for model in self.models}
        return spans.pop() if len(spans) == 1 else None

    def zone(self, name: str) -> Zone:
        """Return the slot's zone of that name."""
        return next(zone for zone in self.zones if zone.name == name)


@dataclass(frozen=True)
class Assignment:
    """A LiDAR, or the left one of a mirrored pair, in a slot, which has a trial's parameters."""

    slot: MountSlot
    lidar: MountedLidar

    @property
    def rig(self) -> Rig:
        """The LiDAR, or both of the mirrored pair."""
        other = replace(self.lidar, mount=mirrored(self.lidar.mount))
        return ordered([self.lidar, other] if self.slot.pair else [self.lidar])
