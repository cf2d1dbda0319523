"""Record box logs of simulated traffic around several egos."""

from __future__ import annotations

import hashlib
import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.regular import regular
from lidarplace.logs.box_log import BoxLog, join_logs
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS, VIEWPOINT_Z
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.routes import KEEP_M, split_of
from lidarplace.scenes.site import POLE, Site
from lidarplace.scenes.sumo.buildings import build_along, overlaps, within_reach
from lidarplace.scenes.sumo.junction import place_of, read_town, with_observer
from lidarplace.scenes.sumo.maps import find_map
from lidarplace.scenes.sumo.mirror import mirror_log
from lidarplace.scenes.sumo.settings import GENERATED, SumoScene, TownRun
from lidarplace.scenes.sumo.town import TownMap, sumo_home
from lidarplace.scenes.sumo.traffic import CAR, cars_among, write_demand
from lidarplace.scenes.sumo.trajectories import LEVEL_M, Trajectories, simulate

if TYPE_CHECKING:
    from sumolib.net import Net

MEETS_M = 40.0  # who comes so near has been met: as far as the paper's ROI reaches ahead
FASTEST_M_S = 30.0
LEAP_M = 5.0
"""A car that gets farther than it can drive, and than a bend of its road explains, was moved."""
_COUNTS = {"source", "towns", "test_towns", "test_seed", "routes", "test_routes", "egos_per_run"}


def choose_egos(traffic: Trajectories, count: int) -> list[int]:
    """Return indices of `count` of the cars that were on the road all the time, sorted.

    Frames of one road user are alike, so egos are added one after the other, each the one that most
    increases the sum over all road users of ln(1 + frames in which an ego meets them). The sum is
    submodular, so it reaches at least 1 - 1/e of what any choice has. Cars that drove less than
    half the median are the last choice: a standing ego gives near-duplicates of one frame. A car
    that SUMO put elsewhere is no ego. Raises ValueError if fewer cars stayed on the road."""
    car = np.array([user.kind is CAR for user in traffic.users])
    hops = np.hypot(*np.diff(traffic.pose[:, :, :2], axis=0).transpose(2, 0, 1))
    leap = LEAP_M + FASTEST_M_S * np.diff(traffic.time_s)[:, None]
    stayed = car & ~np.isnan(traffic.pose[:, :, 0]).any(axis=0) & (hops <= leap).all(axis=0)
    candidates = np.flatnonzero(stayed)
    if len(candidates) < count:
        problem, fix = "too few cars stayed on the road", "ask for fewer routes or more vehicles"
        expected = f"{count} for the whole recording, as egos"
        raise InputError(problem, expected=expected, found=len(candidates), fix=fix)
    met = np.array([frames_met(traffic, ego) for ego in candidates.tolist()])
    distance = traffic.speed[:, candidates].sum(axis=0)
    drives = distance >= np.median(distance) / 2
    chosen: list[int] = []
    frames = np.zeros(len(traffic.users), np.int64)
    for _ in range(count):
        value = np.log1p(frames + met).sum(axis=1)
        ranking = np.lexsort((-value, ~drives))
        chosen.append(next(int(c) for c in ranking if c not in chosen))
        frames += met[chosen[-1]]
    return sorted(candidates[chosen].tolist())


def frames_met(traffic: Trajectories, ego: int) -> NDArray[np.int64]:
    """Count the frames in which each road user is within `MEETS_M` of the ego; shape (U,)."""
    return np.asarray(_near(traffic, ego, MEETS_M).sum(axis=0))


def _near(traffic: Trajectories, ego: int, distance: float) -> NDArray[np.bool_]:
    """Return a mask of others within `distance` of the ego and on its level, by step; (F, U)."""
    x, y = (traffic.pose[:, :, :2] - traffic.pose[:, ego : ego + 1, :2]).transpose(2, 0, 1)
    near: NDArray[np.bool_] = np.hypot(x, y) <= distance  # False where NaN
    near &= np.abs(traffic.z - traffic.z[:, ego : ego + 1]) <= LEVEL_M
    near[:, ego] = False
    return near


def record(scene: SumoScene) -> BoxLog:
    """Simulate the towns of `scene` and log what surrounds its egos; raise as `record_town`."""
    return join_logs([record_town(scene, run) for run in scene.town_runs()])


def record_town(scene: SumoScene, run: TownRun) -> BoxLog:
    """Simulate one of `scene.town_runs()` and log what surrounds its egos.

    Poses and buildings are in the frame of the town. The log is flat: everything stands on the
    ground, and what is on another level of a bridge than the ego is left out. `route` numbers the
    egos; frame `n` of a route is `n` frames after its first, which is `frames_per_route` after that
    of the route before. The same settings give the same bytes.

    Raises ImportError without SUMO, ValueError if the map is missing or broken, or has no sidewalks
    for pedestrians, or there are fewer cars on the road than routes, or more vehicles than fit."""
    sumo_home()
    if run.routes > (cars := cars_among(scene.density)):
        problem = f"{scene.density} gives {cars} cars, too few for {run.routes} {run.part} routes"
        raise InputError(f"{problem} in one simulation", key="density")
    network, town, traffic = drive(scene, run)
    pairs = overlaps(traffic)
    if run.site is None:
        egos = choose_egos(traffic, run.routes)
    else:
        traffic = with_observer(traffic, *place_of(network, town, run.site))
        egos = [len(traffic.users) - 1]
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    for number, ego in enumerate(egos):
        first = run.first_frame + number * scene.frames_per_route
        steps = moved(traffic.pose[:, ego, :2], scene.min_travel_m)
        x, y, yaw = traffic.pose[steps, ego].T
        route = {
            "scene": run.name,
            "frame": first + np.arange(len(steps)),
            "timestamp_s": traffic.time_s[steps],
            "route": run.first_route + number,
            "split": split_of(scene.split, run.part, len(steps)),
            **dict(zip(POSE_COLUMNS, (x, y, _wrap(yaw)), strict=True)),
            **({} if run.site is None else {VIEWPOINT_Z: POLE.high}),
        }
        frames.append(pd.DataFrame(route))
        boxes.append(boxes_around(traffic, pairs, ego, steps, run, first))
    log = BoxLog(pd.concat(boxes, ignore_index=True), pd.concat(frames, ignore_index=True))
    if scene.buildings:
        walls = build_along(network, run.town_seed, run.name, town.lefthand)
        positions = log.frames[list(POSE_COLUMNS[:2])].to_numpy(np.float64)
        log = replace(log, buildings=within_reach(walls, positions))
    return mirror_log(log) if town.mirrored else log


def drive(scene: SumoScene, run: TownRun) -> tuple[Net, TownMap, Trajectories]:
    """Simulate a town run; return its road network, what is to know of it, and its traffic."""
    demand_seed, driving = np.random.SeedSequence(run.traffic_seed).spawn(2)
    with tempfile.TemporaryDirectory(prefix="lidarplace-") as name:
        network, town = read_town(run.town, run.town_seed, Path(name))
        routes = Path(name) / "routes.rou.xml"
        demand = write_demand(network, scene, np.random.default_rng(demand_seed), run.town, routes)
        seed = int(driving.generate_state(1)[0] >> 1)  # SUMO takes 31 bits
        return network, town, simulate(scene, town.path, demand, routes, seed)


def moved(position: NDArray[np.float64], distance: float) -> NDArray[np.int64]:
    """Select the steps at which something is `distance` from where it last was selected.

    `position` has shape (F, 2); the first step is always among them."""
    steps = [0]
    for step, place in enumerate(position):
        if step and math.dist(place, position[steps[-1]]) >= distance:
            steps.append(step)
    return np.array(steps, np.int64)


def boxes_around(
    traffic: Trajectories,
    pairs: NDArray[np.int64],
    ego: int,
    steps: NDArray[np.int64],
    run: TownRun,
    first_frame: int,
) -> pd.DataFrame:
    """Return boxes within `KEEP_M` of the ego and on its level at `steps`, in its frame.

    Of two that overlap the smaller is left out: SUMO lets some road users brush each other where
    lanes and crossings meet, about one pair in twenty frames of a whole town."""
    near = _near(traffic, ego, KEEP_M)
    area = np.array([u.length * u.width for u in traffic.users])
    area[ego] = np.inf
    step, a, b = pairs.T
    near[step, np.where(area[a] < area[b], a, b)] = False
    frame, user = np.nonzero(near[steps])
    at = steps[frame]
    offset = traffic.pose[at, user] - traffic.pose[at, ego]
    cos, sin = (turn(traffic.pose[at, ego, 2]) for turn in (np.cos, np.sin))
    size = np.array([(u.length, u.width, u.height) for u in traffic.users])[user]
    x = cos * offset[:, 0] + sin * offset[:, 1]
    y = cos * offset[:, 1] - sin * offset[:, 0]
    geometry = (x, y, size[:, 2] / 2, *size.T, _wrap(offset[:, 2]))
    return pd.DataFrame(
        {
            "scene": run.name,
            "frame": first_frame + frame,
            "timestamp_s": traffic.time_s[at],
            "object_id": np.array([f"{run.name}-{u.id}" for u in traffic.users])[user],
            "class": np.array([u.kind.object_class for u in traffic.users])[user],
            **dict(zip(GEOMETRY, geometry, strict=True)),
        }
    )


def _wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn angles into (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


@dataclass(frozen=True)
class TownRecording:
    """One simulation of traffic."""

    scene: SumoScene  # without what says which runs there are: `run` has its own
    run: TownRun
    map: str | None  # SHA-256 of the town's map; None for a generated town

    def record(self) -> BoxLog:
        """Simulate it; raise as `record_town` does."""
        return record_town(self.scene, self.run)


def town_parts(scene: SumoScene, site: Site | None = None) -> list[ScenePart]:
    """List the simulations of a scene that have routes, training first.

    Raises ValueError if a map is missing."""
    # Left out is what only says which runs there are: more towns leave these as they are.
    settings = SumoScene.model_validate(scene.model_dump(mode="json", exclude=_COUNTS))
    return [
        ScenePart(
            run.name,
            TownRecording(settings, run, _map_digest(run.town)),
            (run.part,) if scene.split == "route" else ("train", "test"),
        )
        for run in scene.town_runs(site)
        if run.routes
    ]


def _map_digest(town: str) -> str | None:
    if town == GENERATED:
        return None
    path = find_map(town)
    return hashlib.sha256(regular(path).read_bytes()).hexdigest()
