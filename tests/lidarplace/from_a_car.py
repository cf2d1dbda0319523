"""Rays that are cast from a sedan, whose body stops them, too."""

from typing import Any

from lidarplace.clouds import raycast
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.shapes import Parts
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount


def cast(mount: Mount, lidar: Lidar, parts: Parts, *further: Any, **keywords: Any) -> raycast.Hits:
    """`lidarplace.clouds.raycast.cast` with the sedan among the parts."""
    return raycast.cast(mount, lidar, body_parts(None).and_(parts), *further, **keywords)
