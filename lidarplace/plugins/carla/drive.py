"""Drive one route: spawn the traffic of a town, let it run, and record who was where."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.plugins.carla.server import Actors, load_town, synchronous
from lidarplace.plugins.carla.settings import CarlaScene, Route
from lidarplace.plugins.carla.traffic import BOX, EGO, POSE, Traffic
from lidarplace.scenes.routes import STEP_S, seed_of, split_of

if TYPE_CHECKING:
    import carla

WALK_M_S = 1.4
TRIES = 20  # places tried for a pedestrian, most of which stand in nobody's way
SIZES_M = (0.1, 25.0)
"""Smallest and largest believable side of a box; some releases give two-wheelers none."""

BOX_TRUCK_M = (5.2, 2.4, 2.6)
"""Length, width and height over which the paper counts a van as *Van and Cyclist*."""
CLASS_OF: Mapping[str, str] = read_yaml_file(Path(__file__).with_name("classes.yaml"))
"""Blueprints whose class is fixed, whatever their wheels and size."""

Report = Callable[[str], None]


def drive(client: carla.Client, scene: CarlaScene, route: Route, report: Report) -> Traffic:
    """Record one route, no LiDAR is mounted yet; `report` receives what was left out.

    Raises ValueError: the town lacks a map, starts or room, or the ego's blueprint is unknown;
    RuntimeError: the server failed."""
    world = load_town(client, route.town)
    traffic_manager = client.get_trafficmanager(scene.traffic_manager_port)
    with synchronous(world), closing(Actors(client, world)) as actors:
        traffic_manager.set_synchronous_mode(True)
        traffic_manager.set_random_device_seed(route.seed)
        if hasattr(world, "set_pedestrians_seed"):
            world.set_pedestrians_seed(route.seed)
        try:
            vehicles = _spawn_vehicles(world, actors, scene, route, report)
            walkers = _spawn_walkers(world, actors, scene, route, report)
            for vehicle in vehicles:
                vehicle.set_autopilot(True, traffic_manager.get_port())
            for _ in range(scene.warmup_steps):
                world.tick(scene.timeout_s)
            return _record(world, [*vehicles, *walkers], scene, route)
        finally:
            with suppress(RuntimeError):  # not to hide what went wrong before
                traffic_manager.set_synchronous_mode(False)


def _spawn_vehicles(
    world: carla.World, actors: Actors, scene: CarlaScene, route: Route, report: Report
) -> list[carla.Actor]:
    """Spawn the ego, then others of all models at random starts, `scene.density` in all."""
    library = world.get_blueprint_library()
    models = sorted(library.filter("vehicle.*"), key=lambda model: model.id)
    ego_model = next((model for model in models if model.id == scene.ego), None)
    if ego_model is None:
        raise InputError(key="ego", expected="a blueprint of the CARLA server", found=scene.ego)
    points = list(world.get_map().get_spawn_points())
    start = starts([(p.location.x, p.location.y) for p in points], route.start + 1, scene, route)
    ego = actors.spawn(ego_model, points.pop(start))
    if ego is None:
        raise RuntimeError(f"{route.town}: the ego found no room at its start in an empty town")
    vehicles = [ego]
    rng = np.random.default_rng(route.seed)
    boxless: set[str] = set()
    for p in rng.permutation(len(points)):
        if len(vehicles) == scene.density:
            break
        model = models[rng.integers(len(models))]
        vehicle = actors.spawn(model, points[p])
        if vehicle is not None and _has_box(vehicle):
            vehicles.append(vehicle)
        elif vehicle is not None:
            actors.remove(vehicle)
            models.remove(model)
            boxless.add(model.id)
    if boxless:
        report(f"{route.name}: without a believable box, so left out: {', '.join(sorted(boxless))}")
    if len(vehicles) < scene.density:
        most = f"at most {len(vehicles)}, as many as found room"
        raise InputError(place=route.town, key="density", expected=most, found=scene.density)
    return vehicles


def starts(
    points: Sequence[tuple[float, float]], count: int, scene: CarlaScene, route: Route
) -> int:
    """Choose the index of the `count`-th start of a town.

    Raises ValueError: the town has fewer. The first is drawn by the scene's seed, each next one
    lies farthest from those before it, so that the routes cover the town."""
    if len(points) < count:
        expected = f"{count} starts, one for each route"
        raise InputError(place=route.town, expected=expected, found=len(points))
    place = np.array(points)
    index = seed_of(scene.seed, 0, *route.town.encode()) % len(place)
    distance = np.full(len(place), math.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, np.hypot(*(place - place[index]).T))
        index = int(distance.argmax())
    return index


def _has_box(actor: carla.Actor) -> bool:
    box = actor.bounding_box
    sides = [2 * half for half in (box.extent.x, box.extent.y, box.extent.z)]
    away = math.hypot(box.location.x, box.location.y, box.location.z)
    return all(SIZES_M[0] <= side <= SIZES_M[1] for side in sides) and away <= SIZES_M[1]


def _spawn_walkers(
    world: carla.World, actors: Actors, scene: CarlaScene, route: Route, report: Report
) -> list[carla.Actor]:
    """Spawn pedestrians at random places of the sidewalks, each on its way to another."""
    import carla

    library = world.get_blueprint_library()
    models = sorted(library.filter("walker.pedestrian.*"), key=lambda model: model.id)
    rng = np.random.default_rng((route.seed, 1))
    walkers: list[carla.Actor] = []
    for _ in range(TRIES * scene.pedestrians):
        if len(walkers) == scene.pedestrians:
            break
        if (place := world.get_random_location_from_navigation()) is None:
            continue
        walker = actors.spawn(models[rng.integers(len(models))], carla.Transform(place))
        if walker is not None:
            walkers.append(walker)
    if len(walkers) < scene.pedestrians:
        report(
            f"{route.name}: {len(walkers)} of {scene.pedestrians} pedestrians found room in "
            f"{route.town}"
        )
    mind_model = library.find("controller.ai.walker")
    minds = [actors.spawn(mind_model, carla.Transform(), walker) for walker in walkers]
    world.tick(scene.timeout_s)  # a controller can be used one step after it was made
    for mind in minds:
        goal = world.get_random_location_from_navigation()
        if mind is not None and goal is not None:
            mind.start()
            mind.go_to_location(goal)
            mind.set_max_speed(WALK_M_S)
    return walkers


def _record(
    world: carla.World, everybody: Sequence[carla.Actor], scene: CarlaScene, route: Route
) -> Traffic:
    frames: list[tuple[int, float]] = []
    poses: list[tuple[float, ...]] = []
    last = (math.inf, math.inf)
    for f in range(scene.frames_per_route):
        for _ in range(scene.frame_stride):
            world.tick(scene.timeout_s)
        place = everybody[EGO].get_transform().location
        if math.dist((place.x, place.y), last) < scene.min_travel_m:
            continue
        last, frame = (place.x, place.y), route.first_frame + f
        frames.append((frame, f * scene.frame_stride * STEP_S))
        for number, actor in enumerate(everybody):
            if actor.is_alive:
                pose = actor.get_transform()
                at, turn = pose.location, pose.rotation
                poses.append((frame, number, at.x, at.y, at.z, turn.roll, turn.pitch, turn.yaw))
    table = pd.DataFrame(frames, columns=["frame", "timestamp_s"]).assign(
        scene=f"carla-{scene.seed}-{route.part}-{route.town}",
        route=route.number,
        split=split_of(scene.split, route.part, len(frames)),
    )
    return Traffic(
        actors=_describe(everybody, scene),
        poses=pd.DataFrame(poses, columns=["frame", "actor", *POSE]),
        frames=table[["scene", "frame", "timestamp_s", "route", "split"]],
    )


def _describe(everybody: Sequence[carla.Actor], scene: CarlaScene) -> pd.DataFrame:
    rows = []
    for number, actor in enumerate(everybody):
        box = actor.bounding_box
        size = (2 * box.extent.x, 2 * box.extent.y, 2 * box.extent.z)
        wheels = int(actor.attributes.get("number_of_wheels", 0))
        name = object_class(actor.type_id, wheels, size, scene.classes)
        place = (box.location.x, box.location.y, box.location.z)
        rows.append((number, actor.type_id, name, *place, box.rotation.yaw, *size))
    return pd.DataFrame(rows, columns=["actor", "blueprint", "class", *BOX])


def object_class(
    blueprint: str, wheels: int, size: tuple[float, float, float], overrides: Mapping[str, str]
) -> str:
    """Return the class: "Car", "Cyclist" (the paper's Van and Cyclist), "Pedestrian", or any.

    `overrides` by blueprint come first, then `CLASS_OF`. What neither names is Pedestrian if it
    walks, Cyclist on two wheels or over `BOX_TRUCK_M` in all three dimensions, Car otherwise."""
    if named := overrides.get(blueprint) or CLASS_OF.get(blueprint):
        return named
    if blueprint.startswith("walker."):
        return "Pedestrian"
    large = all(side > limit for side, limit in zip(size, BOX_TRUCK_M, strict=True))
    return "Cyclist" if wheels == 2 or large else "Car"
