"""Sites in simulated traffic: where they are in a town, and what a pole must not stand in."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax import SAXException

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point
from lidarplace.files.atomic import reading
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.scenes.routes import KEEP_M
from lidarplace.scenes.site import Obstacles, Site
from lidarplace.scenes.sumo.buildings import build_along, lane_rectangles
from lidarplace.scenes.sumo.maps import build_network
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.scenes.sumo.town import TownMap
from lidarplace.scenes.sumo.traffic import PEDESTRIAN, VEHICLES, RoadUser
from lidarplace.scenes.sumo.trajectories import Trajectories

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.node import Node

CLASSES = tuple(kind.sumo_class for kind in VEHICLES)
NAMED = 3
"""Junctions that an error names."""


def read_town(town: str, seed: int, folder: Path) -> tuple[Net, TownMap]:
    """Read the road network of a town, made in `folder` if need be; raise as `build_network`."""
    from sumolib.net import readNet

    built = build_network(town, seed, folder)
    with reading(built.path, "a SUMO network", SAXException, KeyError, ValueError):
        return readNet(str(built.path), withInternal=True, withPedestrianConnections=True), built


def place_of(network: Net, town: TownMap, site: Site) -> tuple[NDArray[np.float64], float]:
    """Return x, y, yaw of a site in the frame of the network, and the height of the road there.

    Without x and y at the junction with most lanes, of equal ones the first by name. Raises
    ValueError: no road is near."""
    side = -1 if town.mirrored else 1
    yaw = side * math.radians(site.yaw_deg)
    if site.x is None or site.y is None:
        x, y = max(_junctions(network), key=_lanes).getCoord()
    else:
        x, y = site.x, side * site.y
    corners = [
        corner
        for edge in network.getEdges()
        for lane in edge.getLanes()
        for corner in lane.getShape3D()
    ]
    roads = lane_rectangles(network)
    away = np.hypot(*(roads[:, :2] - [x, y]).T) - roads[:, 3]
    if away.min() > KEEP_M:
        near = sorted(_junctions(network), key=lambda node: math.dist(node.getCoord(), (x, y)))
        where = ", ".join(point(*np.round(node.getCoord(), 1) * [1, side]) for node in near[:NAMED])
        problem = f"{point(x, side * y)} is off the map, {away.min():.0f} m from its roads"
        raise InputError(problem, key="site", fix=f"junctions are at {where}")
    height = min(corners, key=lambda corner: math.dist(corner[:2], (x, y)))[2]
    return np.array([x, y, yaw]), float(height)


def _junctions(network: Net) -> list[Node]:
    return sorted(network.getNodes(), key=lambda node: str(node.getID()))


def _lanes(node: Node) -> int:
    return sum(edge.getLaneNumber() for edge in (*node.getIncoming(), *node.getOutgoing()))


def with_observer(traffic: Trajectories, pose: NDArray[np.float64], height: float) -> Trajectories:
    """Return the traffic with one more road user, the last, that has no size and never moves."""
    steps = len(traffic.time_s)

    def added(
        values: NDArray[np.float64], more: NDArray[np.float64] | float
    ) -> NDArray[np.float64]:
        column = np.broadcast_to(more, (steps, 1, *values.shape[2:]))
        return np.concatenate([values, column], axis=1)

    return replace(
        traffic,
        users=[*traffic.users, RoadUser("site", PEDESTRIAN, 0.0, 0.0, 0.0)],
        pose=added(traffic.pose, pose),
        z=added(traffic.z, height),
        speed=added(traffic.speed, 0.0),
    )


def obstacles_at(scene: SumoScene, site: Site) -> Obstacles:
    """Return buildings and lanes around a site, in its frame; raises as `place_of`."""
    run = scene.town_runs(site)[0]
    with tempfile.TemporaryDirectory(prefix="lidarplace-") as name:
        network, town = read_town(run.town, run.town_seed, Path(name))
    (x, y, yaw), _ = place_of(network, town, site)
    walls = np.empty((0, len(GEOMETRY)))
    if scene.buildings:
        built = build_along(network, run.town_seed, run.name, town.lefthand)
        walls = built[list(GEOMETRY)].to_numpy(np.float64)
    return Obstacles.around((x, y, yaw), walls, lane_rectangles(network, CLASSES), town.mirrored)
