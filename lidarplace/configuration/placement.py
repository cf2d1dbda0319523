"""A placement in a configuration: by coordinates, or the paper's by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from lidarplace.base.errors import InputError, at
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings, further_sensors
from lidarplace.configuration.pose import PoseSettings
from lidarplace.configuration.sensor import Losses, SensorSettings
from lidarplace.configuration.settings import Name, Settings, short_for, validated
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.rigs.pose import from_carla

MOST_MOUNTS = 100


class MountSettings(PoseSettings):
    """Pose of one LiDAR and its model, in the convention of its placement."""

    lidar: Annotated[SensorSettings, short_for("name")] | None = Field(
        None, description="this mount's own LiDAR model; by default that of the whole placement"
    )


class PlacementSettings(Settings):
    """A placement by coordinates, as in files; mounts without a LiDAR model get one later."""

    convention: Literal["ego", "carla"] = Field(
        "ego",
        description="ego: right-handed, y to the left, pitch > 0 tips the nose down; "
        "carla: left-handed, y to the right, pitch > 0 lifts the nose",
    )
    mounts: tuple[MountSettings, ...] = Field(
        min_length=1, max_length=MOST_MOUNTS, description="a LiDAR each"
    )
    cameras: tuple[CameraSettings, ...] = Field(
        (), max_length=MOST_MOUNTS, description="they count in requirements, and make no clouds"
    )
    radars: tuple[RadarSettings, ...] = Field(
        (), max_length=MOST_MOUNTS, description="they count in requirements, and make no clouds"
    )

    def further(self) -> tuple[MountedSensor, ...]:
        """Build cameras, then radars, in our ego frame.

        Raises ValueError as `further_sensors` does."""
        mounts = self.in_ego((*self.cameras, *self.radars))
        return further_sensors(self.cameras, self.radars, mounts)

    def in_ego(self, mounts: Sequence[PoseSettings]) -> list[Mount]:
        """Convert mounts of the placement to our ego frame."""
        poses = (mount.pose for mount in mounts)
        return [Mount(*(from_carla(*p) if self.convention == "carla" else p)) for p in poses]

    def placement(self, name: str, lidar: Lidar, losses: Losses = ()) -> Placement:
        """Build the placement in our ego frame, `lidar` on mounts without a model.

        Models get the `losses` that they lack. Raises ValueError as `Placement` does."""
        return Placement(name, self.in_ego(self.mounts), _lidars(self.mounts, lidar, losses))


class SweptPlacementSettings(PlacementSettings):
    """A placement of a sweep; only sweeps allow dead LiDARs.

    In place of coordinates it may name LiDARs of the rig that recorded the scene's log."""

    mounts: tuple[MountSettings, ...] = Field(
        (), max_length=MOST_MOUNTS, description="a LiDAR each"
    )
    recorded: tuple[Name, ...] = Field(
        (),
        max_length=MOST_MOUNTS,
        description="instead of mounts: names of LiDARs of the rig that recorded the log",
    )
    dead: tuple[MountSettings, ...] = Field(
        (),
        max_length=MOST_MOUNTS,
        description="dead LiDARs: they see nothing, but their housings hide objects behind them",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> SweptPlacementSettings:
        if self.recorded and (others := self.model_fields_set - {"recorded"}):
            fix = "leave it out, or recorded"
            raise InputError("a recorded rig is as it was", key=min(others), fix=fix)
        if not (self.mounts or self.recorded):
            raise InputError("missing", key="mounts", expected="mounts, or recorded: LiDAR names")
        if len(set(self.recorded)) < len(self.recorded):
            names = ", ".join(self.recorded)
            raise InputError(key="recorded", expected="each LiDAR once", found=names)
        return self

    def placement(self, name: str, lidar: Lidar, losses: Losses = ()) -> Placement:
        """Build the placement as `PlacementSettings` does, with its dead LiDARs."""
        lidars = _lidars(self.mounts, lidar, losses)
        dead = zip(self.in_ego(self.dead), _lidars(self.dead, lidar, losses), strict=True)
        return Placement(name, self.in_ego(self.mounts), lidars, tuple(dead))


def _lidars(mounts: Sequence[MountSettings], lidar: Lidar, losses: Losses) -> list[Lidar]:
    return [lidar if mount.lidar is None else mount.lidar.lidar(losses) for mount in mounts]


def named_placement(name: str, lidar: Lidar) -> Placement:
    """Return the paper's placement of this name, or the one in the file FILE.yaml, with `lidar`.

    Raises OSError and ValueError as `read_placement`; or there is no placement of that name."""
    if name.endswith((".yaml", ".yml")):
        return read_placement(Path(name), lidar)
    if name not in PAPER_PLACEMENTS:
        wrong = f"no placement {name!r}{did_you_mean(name, PAPER_PLACEMENTS)}"
        names = f"{', '.join(PAPER_PLACEMENTS)} or a FILE.yaml"
        raise InputError(wrong, place="--placement", expected=names)
    return PAPER_PLACEMENTS[name].with_lidar(lidar)


def read_placement(path: Path, lidar: Lidar) -> Placement:
    """Read the keys of `PlacementSettings`; the placement has the name of the file.

    Raises OSError: the file cannot be read; ValueError: it is not such a list."""
    settings = read_placement_settings(path)
    with at(path):
        return settings.placement(path.stem, lidar)


def read_placement_settings(path: Path) -> PlacementSettings:
    """Read the settings in a placement's file.

    Raises OSError and ValueError as `read_placement` does."""
    raw = read_yaml_file(path)
    if isinstance(raw, dict) and "mounts" in raw and "search" in raw:  # the answer of a search
        raw = {key: value for key, value in raw.items() if key in PlacementSettings.model_fields}
    if isinstance(raw, dict) and "mounts" not in raw:
        such = "a list of LiDARs, such as mounts: [{x: 0, y: 0, z: 2}]"
        chosen = path.with_name("placement.yaml")
        fix = f"use {chosen}" if "placements" in raw and chosen.is_file() else ""
        raise InputError("missing", place=path, key="mounts", expected=such, fix=fix)
    return validated(PlacementSettings, raw, str(path), path.parent)
