"""Cameras and radars of a rig: they make no clouds, and detectors do not know them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from lidarplace.rigs.placement import Mount

Kind = Literal["lidar", "camera", "radar"]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks along the x axis of its mount."""

    pixels: tuple[int, int]  # width and height of its images
    focal: tuple[float, float]  # focal lengths across and up, pixels
    centre: tuple[float, float]  # principal point from the left and the upper edge, pixels
    ranges: tuple[tuple[str, float], ...] = ()
    """Farthest use by class of the object, metres; "" for any other. None has no end."""


@dataclass(frozen=True)
class Radar:
    """A radar with a box of angles."""

    azimuth: tuple[float, float]  # the first one and how far it goes on to the left, radians
    elevation: tuple[float, float]  # lowest and highest, radians
    ranges: tuple[tuple[str, float], ...]  # as those of a camera


@dataclass(frozen=True)
class MountedSensor:
    """A camera or a radar on a vehicle; x of its mount is ahead, y to the left, as of LiDARs."""

    name: str
    mount: Mount
    model: Camera | Radar

    @property
    def kind(self) -> Kind:
        """Kind of the sensor: camera or radar."""
        return "camera" if isinstance(self.model, Camera) else "radar"

    def range_of(self, object_class: str | None) -> float:
        """Return the range for objects of a class, or any other, metres; infinite without end."""
        ranges = dict(self.model.ranges)
        return ranges.get(object_class or "", ranges.get("", math.inf))
