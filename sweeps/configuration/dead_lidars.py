"""A placement of a sweep, some of whose LiDARs may be dead."""

from __future__ import annotations

from dataclasses import replace

from pydantic import Field

from lidarplace.configuration.placement import MOST_MOUNTS, MountSettings, PlacementSettings
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement


class SweptPlacementSettings(PlacementSettings):
    """A placement by coordinates."""

    dead: tuple[MountSettings, ...] = Field(
        (),
        max_length=MOST_MOUNTS,
        description="further LiDARs that see nothing; by their size they hide what is behind them",
    )

    def placement(self, name: str, lidar: Lidar) -> Placement:
        """As that of `PlacementSettings`, with what is dead."""
        working = super().placement(name, lidar)
        if not self.dead:
            return working
        dead = PlacementSettings(convention=self.convention, mounts=self.dead)
        alone = dead.placement(name, lidar)
        return replace(working, dead=tuple(zip(alone.mounts, alone.lidars, strict=True)))
