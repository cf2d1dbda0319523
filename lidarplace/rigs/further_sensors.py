"""Cameras and radars of a rig: they make no clouds, and detectors do not know them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from lidarplace.rigs.placement import Mount

Kind = Literal["lidar", "camera", "radar"]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks along the x axis of its mount.

    Attributes:
        pixels: width and height of its images.
        focal: focal lengths across and up, pixels.
        centre: principal point from the left and the upper edge, pixels.
        ranges: farthest use by class of the object, metres; "" for any other. None has no end.
    """

    pixels: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    ranges: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Radar:
    """A radar with a box of angles.

    Attributes:
        azimuth: the first one and how far it goes on to the left, radians.
        elevation: lowest and highest, radians.
        ranges: farthest detection by class of the object, metres; "" for any other.
    """

    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    ranges: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class MountedSensor:
    """A camera or a radar on a vehicle.

    Attributes:
        name: in its rig.
        mount: x ahead, y to the left, z up, as those of LiDARs.
        model: what it is.
    """

    name: str
    mount: Mount
    model: Camera | Radar

    @property
    def kind(self) -> Kind:
        """Which of the two."""
        return "camera" if isinstance(self.model, Camera) else "radar"

    def range_of(self, object_class: str | None) -> float:
        """How far an object of a class, or any other, is seen, metres; infinite without end."""
        ranges = dict(self.model.ranges)
        return ranges.get(object_class or "", ranges.get("", math.inf))
