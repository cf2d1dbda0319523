"""Rays that are cast from a sedan, whose body stops them, too."""

from typing import Any

from lidarplace.lidar import raycast
from lidarplace.lidar.own_body import body_parts
from lidarplace.lidar.shapes import Parts
from lidarplace.placement import Mount
from lidarplace.sensor import Lidar


def cast(mount: Mount, lidar: Lidar, parts: Parts, *further: Any, **keywords: Any) -> raycast.Hits:
    """`lidarplace.lidar.raycast.cast` with the sedan among the parts."""
    return raycast.cast(mount, lidar, body_parts(None).and_(parts), *further, **keywords)
