"""A placement's LiDARs as CARLA's ray-cast sensors."""

from __future__ import annotations

import math
import queue
from dataclasses import astuple
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.clouds import Crop
from lidarplace.plugins.carla.server import Actors
from lidarplace.rig_files.carla import BLUEPRINT, attributes, even_fans
from lidarplace.rigs.lidar import HAIR, Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import from_carla

if TYPE_CHECKING:
    import carla


BODY_MARGIN_M = 0.1
"""Mirrors and aerials reach so far out of the ego's box; returns from it are left out."""

Points = NDArray[np.float32]


def mount_transform(mount: Mount, origin: tuple[float, float]) -> carla.Transform:
    """Return CARLA's pose of a mount on an actor whose ego frame starts at `origin`, x and y."""
    import carla

    x, y, z, roll, pitch, yaw = from_carla(*astuple(mount))
    return carla.Transform(
        carla.Location(x=x + origin[0], y=y + origin[1], z=z),
        carla.Rotation(roll=math.degrees(roll), pitch=math.degrees(pitch), yaw=math.degrees(yaw)),
    )


class Rig:
    """Sensors of a `Placement` on an actor, which live in the server."""

    def __init__(
        self,
        actors: Actors,
        library: carla.BlueprintLibrary,
        ego: carla.Actor,
        placement: Placement,
        crop: Crop,
        seed: int,
    ) -> None:
        """Mount the sensors; they take part from the next step on.

        Points outside of `crop`, in the ego frame, are left out; `seed` decides which returns are
        dropped. Raises RuntimeError: the server cannot make one of them."""
        self._placement, self._crop = placement, crop
        extent = ego.bounding_box.extent
        self._body = (2 * extent.x, 2 * extent.y, 2 * extent.z)
        self._arrived: queue.SimpleQueue[tuple[int, int, Points]] = queue.SimpleQueue()
        self._mount_of: list[int] = []
        centre = ego.bounding_box.location
        for m, (mount, lidar) in enumerate(zip(placement.mounts, placement.lidars, strict=True)):
            for fan in even_fans(lidar.elevations):
                blueprint = library.find(BLUEPRINT)
                number = len(self._mount_of)
                for name, value in attributes(lidar, fan, seed + number).items():
                    if name != "noise_seed" or blueprint.has_attribute(name):
                        blueprint.set_attribute(name, value)
                sensor = actors.spawn(blueprint, mount_transform(mount, (centre.x, centre.y)), ego)
                if sensor is None:
                    raise RuntimeError(f"placement {placement.name}: no room for LiDAR {m + 1}")
                self._mount_of.append(m)
                sensor.listen(partial(_deliver, self._arrived, number))

    def clouds(self, step: int, timeout_s: float) -> list[Points]:
        """Collect the returns of every LiDAR in CARLA's frame `step`, in the ego frame.

        Waits until all sensors have delivered, or raises TimeoutError; data of earlier frames are
        dropped."""
        returns: dict[int, Points] = {}
        while len(returns) < len(self._mount_of):
            try:
                frame, number, points = self._arrived.get(timeout=timeout_s)
            except queue.Empty:
                missing = sorted({m for s, m in enumerate(self._mount_of) if s not in returns})
                raise TimeoutError(
                    f"placement {self._placement.name}: LiDAR {missing[0] + 1} delivered nothing "
                    f"for CARLA's frame {step} within {timeout_s:g} s"
                ) from None
            if frame == step:
                returns[number] = points
        clouds: list[list[Points]] = [[] for _ in self._placement.mounts]
        for number in sorted(returns):
            m = self._mount_of[number]
            mount, lidar = self._placement.mounts[m], self._placement.lidars[m]
            clouds[m].append(ego_points(returns[number], mount, lidar, self._crop, self._body))
        return [np.concatenate(parts) for parts in clouds]


def _deliver(arrived: queue.SimpleQueue[tuple[int, int, Points]], number: int, data: Any) -> None:
    """Deliver data from CARLA's own thread, copied, as their memory is CARLA's."""
    points = np.frombuffer(data.raw_data, np.float32).reshape(-1, 4).copy()
    arrived.put((data.frame, number, points))


def ego_points(
    returns: Points, mount: Mount, lidar: Lidar, crop: Crop, body: tuple[float, float, float]
) -> Points:
    """Convert returns to the ego frame, without those out of sight or crop, and on the own body.

    CARLA fired the full turn: the field of view of `lidar` counts. `returns` are x, y, z, intensity
    in the sensor's left-handed frame, shape (n, 4); `body` is the ego's length, width and height.
    """
    x, y, z = returns[:, :3].astype(np.float64).T * [[1.0], [-1.0], [1.0]]
    low, high = lidar.azimuth
    seen = lidar.full_turn | ((np.arctan2(y, x) - (low - HAIR)) % (2 * math.pi) < high - low)
    ahead, left, up = mount.rotation.T[:, :, None]
    place = ahead * x + left * y + up * z + mount.position[:, None]
    low_ends, high_ends = np.reshape(crop, (2, 3, 1))
    seen &= ((low_ends <= place) & (place <= high_ends)).all(axis=0)
    half = np.array(body)[:, None] / 2
    centre = half * [[0.0], [0.0], [1.0]]
    seen &= ~(np.abs(place - centre) <= half + BODY_MARGIN_M).all(axis=0)
    return np.asarray(np.column_stack([place.T, returns[:, 3]])[seen], np.float32)
