"""The rig of a recording: which LiDARs were on the vehicle, where, and of what model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lidarplace.base.suggestions import did_you_mean
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class RecordedRig:
    """LiDARs by name, as they were when a log was recorded. JSON holds it as `asdict` does.

    Attributes:
        names: of the LiDARs, in the order of the mounts, such as ("up_lidar", "down_lidar").
        placement: their mounts in the ego frame, and their models.

    Raises:
        ValueError: there is not one name for each mount, two names are equal or one is empty, or a
            LiDAR fires a pattern of rays, which no file holds.
    """

    names: tuple[str, ...]
    placement: Placement

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        if len(self.names) != len(self.placement.mounts):
            raise ValueError(
                f"rig: {len(self.names)} names for {len(self.placement.mounts)} LiDARs"
            )
        if len(set(self.names)) < len(self.names) or not all(self.names):
            raise ValueError(f"rig: duplicate or empty name of a LiDAR in {', '.join(self.names)}")
        for name, lidar in zip(self.names, self.placement.lidars, strict=True):
            if lidar.pattern is not None:
                raise ValueError(
                    f"rig: LiDAR {name} has a scan pattern; expected beams that turn, because a "
                    "log's rig.json holds no pattern"
                )

    def subset(self, names: Sequence[str]) -> RecordedRig:
        """The rig with these LiDARs only, in its own order.

        Raises:
            ValueError: a name is unknown, or there is none.
        """
        for name in names:
            if name not in self.names:
                raise ValueError(
                    f"unknown LiDAR {name!r} of the recorded rig; expected {', '.join(self.names)}"
                    f"{did_you_mean(name, self.names)}"
                )
        kept = [n for n, name in enumerate(self.names) if name in names]
        own = tuple(self.names[n] for n in kept)
        placement = self.placement
        return RecordedRig(
            own,
            Placement(
                "+".join(own) if len(own) < len(self.names) else placement.name,
                [placement.mounts[n] for n in kept],
                [placement.lidars[n] for n in kept],
            ),
        )
