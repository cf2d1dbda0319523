"""Show a recorded route to a placement: everybody is put where they were, and the LiDARs fire.

All placements see the same traffic because it is the same poses. CARLA's own recorder is not
used: in several releases LiDARs look through what it replays, and its file stays on the server.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from lidarplace.clouds.clouds import PointClouds
from lidarplace.plugins.carla.lidars import Rig
from lidarplace.plugins.carla.returns import Points
from lidarplace.plugins.carla.server import Actors, actors, load_town, synchronous
from lidarplace.plugins.carla.settings import CarlaScene, Route
from lidarplace.plugins.carla.traffic import EGO, POSE, Traffic
from lidarplace.rigs.placement import Placement

if TYPE_CHECKING:
    import carla

Poses = dict[int, "carla.Transform"]

ASTRAY_M = 0.1
"""An actor this far from its recorded place makes clouds that do not fit the boxes."""

APART_M = 25.0
"""Distance of the actors while they wait above the town."""

ABOVE_M = 300.0
"""Height at which they wait."""


def replay(
    client: carla.Client, scene: CarlaScene, route: Route, traffic: Traffic, placement: Placement
) -> PointClouds:
    """The clouds of one placement in all frames of a recorded route.

    Raises:
        TimeoutError: a LiDAR did not deliver.
        RuntimeError: the server failed, or somebody is not where it was put.
    """
    world = load_town(client, route.town)
    with synchronous(world), actors(client, world) as own:
        everybody = _spawn(world, own, traffic)
        library = world.get_blueprint_library()
        rig = Rig(own, library, everybody[EGO], placement, scene.crop, route.seed)

        def clouds() -> Iterator[tuple[Points, list[int]]]:
            for frame, poses in _by_frame(traffic):
                step = _put(client, world, everybody, poses, scene.timeout_s)
                _check_places(everybody, poses, frame)
                seen = rig.clouds(step, scene.timeout_s)
                yield np.concatenate(seen), [len(cloud) for cloud in seen]

        # The first frame once before it counts: what the LiDARs do in their first step differs
        # between releases.
        first = next(_by_frame(traffic))[1]
        rig.clouds(_put(client, world, everybody, first, scene.timeout_s), scene.timeout_s)
        return PointClouds.from_frames(traffic.frames["frame"], clouds(), scene.crop)


def _spawn(world: carla.World, own: Actors, traffic: Traffic) -> list[carla.Actor]:
    """The recorded actors, side by side above the town, without physics: they only go where put."""
    library = world.get_blueprint_library()
    row = math.ceil(math.sqrt(len(traffic.actors)))
    everybody = []
    for number, name in zip(traffic.actors["actor"], traffic.actors["blueprint"], strict=True):
        actor = own.spawn(library.find(name), _waiting_place(number, row))
        if actor is None:
            raise RuntimeError(f"the server cannot make {name} again")
        actor.set_simulate_physics(False)
        everybody.append(actor)
    return everybody


def _waiting_place(number: int, row: int) -> carla.Transform:
    import carla

    x, y = divmod(number, row)
    return carla.Transform(carla.Location(x=APART_M * x, y=APART_M * y, z=ABOVE_M))


def _by_frame(traffic: Traffic) -> Iterator[tuple[int, Poses]]:
    """Frame number and the pose of everybody; who was not there waits above the town."""
    import carla

    row = math.ceil(math.sqrt(len(traffic.actors)))
    by_frame = traffic.poses.groupby("frame")
    for frame in traffic.frames["frame"].tolist():
        poses = {
            int(number): _waiting_place(int(number), row) for number in traffic.actors["actor"]
        }
        present = by_frame.get_group(frame)
        for number, x, y, z, roll, pitch, yaw in zip(
            *(present[name].tolist() for name in ("actor", *POSE)), strict=True
        ):
            poses[number] = carla.Transform(
                carla.Location(x=x, y=y, z=z), carla.Rotation(roll=roll, pitch=pitch, yaw=yaw)
            )
        yield frame, poses


def _put(
    client: carla.Client,
    world: carla.World,
    everybody: list[carla.Actor],
    poses: Poses,
    timeout_s: float,
) -> int:
    """Put everybody in place and step; returns CARLA's number of the step."""
    import carla

    client.apply_batch_sync(
        [carla.command.ApplyTransform(everybody[number].id, pose) for number, pose in poses.items()]
    )
    return int(world.tick(timeout_s))


def _check_places(everybody: list[carla.Actor], poses: Poses, frame: int) -> None:
    for number, pose in poses.items():
        away = everybody[number].get_transform().location.distance(pose.location)
        if away > ASTRAY_M:
            raise RuntimeError(
                f"frame {frame}: {everybody[number].type_id} stands {away:.2f} m from where it was "
                "recorded, so the clouds would not fit the boxes"
            )
