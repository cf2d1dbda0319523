"""Road users of a town: kinds of objects, their sizes, and where they start."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.scenes.sumo.walks import WalkGraph, drive_graph, foot_graph

if TYPE_CHECKING:
    from sumolib.net import Net

Interval = tuple[float, float]


class Kind(NamedTuple):
    """A kind of road user; sizes are from the smallest to the largest, uniform and independent."""

    name: str  # first part of the ids of its objects
    object_class: str  # in the box log
    sumo_class: str  # SUMO's vehicle class, which decides where it may go
    length: Interval  # metres
    width: Interval
    height: Interval
    share: float = 0.0  # of the vehicles in a scene


CAR = Kind("car", "Car", "passenger", (3.8, 5.0), (1.65, 2.0), (1.4, 1.8), share=0.70)
BOX_TRUCK = Kind("truck", "Cyclist", "truck", (5.3, 7.5), (2.41, 2.55), (2.61, 3.4), share=0.08)
MOTORCYCLE = Kind(
    "motorcycle", "Cyclist", "motorcycle", (2.0, 2.3), (0.7, 0.9), (1.5, 1.8), share=0.10
)
BICYCLE = Kind("bicycle", "Cyclist", "bicycle", (1.6, 1.9), (0.5, 0.7), (1.6, 1.85), share=0.12)
VEHICLES = (CAR, BOX_TRUCK, MOTORCYCLE, BICYCLE)
PEDESTRIAN = Kind("pedestrian", "Pedestrian", "pedestrian", (0.4, 0.7), (0.5, 0.7), (1.5, 1.9))
WALK_M_S = 1.5  # a pedestrian's speed; like the speed limits it decides how long a route must be
SPARE = 1.5
"""Routes are so much longer than that: SUMO's drivers differ and may exceed the limit a little."""


class RoadUser(NamedTuple):
    """One object of a scene: its id in SUMO and in the log, and its size in metres."""

    id: str
    kind: Kind
    length: float
    width: float
    height: float


def cars_among(density: int) -> int:
    """Count the cars among `density` vehicles."""
    return sum(kind is CAR for kind in _kinds(density))


def _kinds(density: int) -> list[Kind]:
    """Return the kind of every vehicle: shares by largest remainder, so a car comes first."""
    quotas = [kind.share * density for kind in VEHICLES]
    counts = [int(quota) for quota in quotas]
    by_remainder = sorted(range(len(VEHICLES)), key=lambda k: counts[k] - quotas[k])
    for k in by_remainder[: density - sum(counts)]:
        counts[k] += 1
    return [kind for kind, count in zip(VEHICLES, counts, strict=True) for _ in range(count)]


class Demand(NamedTuple):
    """The road users of a simulation, by id, and the lanes of each of SUMO's vehicle classes."""

    users: list[RoadUser]
    drives: dict[str, WalkGraph]


def write_demand(
    network: Net, scene: SumoScene, rng: np.random.Generator, town: str, path: Path
) -> Demand:
    """Write SUMO's route file of the vehicles and pedestrians of `scene` to `path`.

    Everybody starts at once and wanders at random for longer than the simulation, so that nobody
    leaves. `network` was read with its pedestrian connections; `town` names it in errors. Raises
    ValueError if there are no lanes or no sidewalks on which to wander without end."""
    drives = {kind.sumo_class: drive_graph(network, kind.sumo_class) for kind in VEHICLES}
    foot = foot_graph(network, WALK_M_S)
    users: list[RoadUser] = []
    root = ElementTree.Element("routes")
    for number, kind in enumerate([*_kinds(scene.density), *[PEDESTRIAN] * scene.pedestrians]):
        length, width, height = (
            float(rng.uniform(*interval)) for interval in (kind.length, kind.width, kind.height)
        )
        user = RoadUser(f"{kind.name}{number:05d}", kind, length, width, height)
        users.append(user)
        sides = {"length": f"{length:.3f}", "width": f"{width:.3f}", "height": f"{height:.3f}"}
        size = {"id": user.id, "vClass": kind.sumo_class, **sides}
        ElementTree.SubElement(root, "vType", size)
        graph = foot if kind is PEDESTRIAN else drives[kind.sumo_class]
        if not graph.edges:
            if kind is PEDESTRIAN:
                problem, key = "no sidewalks that lead on and on", "pedestrians"
                asked_for = scene.pedestrians
                raise InputError(problem, place=town, key=key, expected=0, found=asked_for)
            raise InputError(f"no lanes that lead a {kind.name} on and on", place=town)
        start = graph.anywhere(rng)
        edges = " ".join(graph.walk(SPARE * scene.seconds, rng, start))
        start_of = {"id": user.id, "type": user.id, "depart": "0"}
        if kind is PEDESTRIAN:
            person = ElementTree.SubElement(root, "person", start_of, departPos="random")
            ElementTree.SubElement(person, "walk", edges=edges)
        else:
            start_of["departLane"] = graph.keys[start].rpartition("_")[2]
            vehicle = ElementTree.SubElement(root, "vehicle", start_of, departPos="random_free")
            ElementTree.SubElement(vehicle, "route", edges=edges)
    ElementTree.ElementTree(root).write(path)
    return Demand(sorted(users, key=lambda user: user.id), drives)
