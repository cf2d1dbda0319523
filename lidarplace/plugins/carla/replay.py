"""Replay of a recorded route: everybody is put where they were, and a placement's LiDARs fire.

Through what CARLA's own recorder replays, LiDARs look in several releases."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np

from lidarplace.clouds.clouds import PointClouds
from lidarplace.plugins.carla.lidars import Points, Rig
from lidarplace.plugins.carla.server import Actors, load_town, synchronous
from lidarplace.plugins.carla.settings import CarlaScene, Route
from lidarplace.plugins.carla.traffic import EGO, POSE, Traffic
from lidarplace.rigs.placement import Placement

if TYPE_CHECKING:
    import carla

Poses = dict[int, "carla.Transform"]

ASTRAY_M = 0.1  # an actor this far from its recorded place makes clouds that do not fit the boxes
APART_M, ABOVE_M = 25.0, 300.0  # distance of actors, and height, while they wait above the town


def replay(
    client: carla.Client, scene: CarlaScene, route: Route, traffic: Traffic, placement: Placement
) -> PointClouds:
    """Simulate the clouds of one placement in all frames of a recorded route.

    Raises TimeoutError: a LiDAR did not deliver; RuntimeError: the server failed, or somebody is
    not where it was put."""
    import carla

    world = load_town(client, route.town)
    with synchronous(world), closing(Actors(client, world)) as actors:
        everybody = _spawn(world, actors, traffic)
        library = world.get_blueprint_library()
        rig = Rig(actors, library, everybody[EGO], placement, scene.crop, route.seed)

        def fired(poses: Poses, frame: int | None) -> list[Points]:
            """Put everybody in place, step, and wait for the LiDARs."""
            move = carla.command.ApplyTransform
            client.apply_batch_sync([move(everybody[n].id, pose) for n, pose in poses.items()])
            step = int(world.tick(scene.timeout_s))
            if frame is not None:
                _check_places(everybody, poses, frame)
            return rig.clouds(step, scene.timeout_s)

        # The first frame once before it counts: what the LiDARs do in their first step differs
        # between releases.
        fired(next(_by_frame(traffic))[1], None)
        seen = (fired(poses, frame) for frame, poses in _by_frame(traffic))
        clouds = ((np.concatenate(parts), list(map(len, parts))) for parts in seen)
        return PointClouds.from_frames(traffic.frames["frame"], clouds, scene.crop)


def _spawn(world: carla.World, actors: Actors, traffic: Traffic) -> list[carla.Actor]:
    """Spawn the recorded actors, side by side above the town, without physics."""
    library, places = world.get_blueprint_library(), _waiting_places(traffic)
    everybody = []
    for number, name in zip(traffic.actors["actor"], traffic.actors["blueprint"], strict=True):
        actor = actors.spawn(library.find(name), places[number])
        if actor is None:
            raise RuntimeError(f"the server cannot make {name} again")
        actor.set_simulate_physics(False)
        everybody.append(actor)
    return everybody


def _waiting_places(traffic: Traffic) -> Poses:
    import carla

    row = math.ceil(math.sqrt(len(traffic.actors)))
    places = {number: divmod(number, row) for number in traffic.actors["actor"].tolist()}
    return {
        number: carla.Transform(carla.Location(x=APART_M * x, y=APART_M * y, z=ABOVE_M))
        for number, (x, y) in places.items()
    }


def _by_frame(traffic: Traffic) -> Iterator[tuple[int, Poses]]:
    """Yield frame number and the pose of everybody; who was not there waits above the town."""
    import carla

    by_frame = traffic.poses.groupby("frame")
    for frame in traffic.frames["frame"].tolist():
        poses = _waiting_places(traffic)
        present = by_frame.get_group(frame)[["actor", *POSE]]
        for number, x, y, z, roll, pitch, yaw in present.itertuples(index=False):
            turned = carla.Rotation(roll=roll, pitch=pitch, yaw=yaw)
            poses[int(number)] = carla.Transform(carla.Location(x=x, y=y, z=z), turned)
        yield frame, poses


def _check_places(everybody: list[carla.Actor], poses: Poses, frame: int) -> None:
    for number, pose in poses.items():
        away = everybody[number].get_transform().location.distance(pose.location)
        if away > ASTRAY_M:
            raise RuntimeError(
                f"frame {frame}: {everybody[number].type_id} stands {away:.2f} m from where it was "
                "recorded, so the clouds would not fit the boxes"
            )
