"""Record box logs of simulated traffic around several egos."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.box_log import BoxLog
from lidarplace.boxes import BOX_COLUMNS, FRAME_COLUMNS
from lidarplace.scenes.overlap import overlaps
from lidarplace.scenes.settings import TEST_EVERY, SumoScene
from lidarplace.scenes.town import build_town, sumo_home
from lidarplace.scenes.traffic import CAR, cars_among, write_demand
from lidarplace.scenes.trajectories import Trajectories, simulate

KEEP_M = 60.0
"""Boxes whose centre is farther from the ego are not logged: the ROI's far corner is 45 m away,
and half a truck and what stands before it still counts."""


def record(scene: SumoScene) -> BoxLog:
    """Simulate the towns of `scene` and log what surrounds its egos.

    Returns the box log: `boxes` with the columns `BOX_COLUMNS`, `frames` with `FRAME_COLUMNS`, in
    the ego frame; the ego itself is not in it. `route` numbers the egos, training routes first;
    `frame` counts through the whole log. The same settings give the same bytes.

    Raises:
        ImportError: SUMO is not installed.
        ValueError: there are fewer cars on the road than routes, or more vehicles than fit.
    """
    sumo_home()
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    for town, (part, routes) in enumerate((("train", scene.routes), ("test", scene.test_routes))):
        if routes == 0:
            continue
        cars = cars_among(scene.density)
        if routes > cars:
            raise ValueError(
                f"density {scene.density} gives {cars} cars, too few for {routes} {part} routes"
            )
        traffic = drive(scene, town)
        pairs = overlaps(traffic)
        for ego in choose_egos(traffic, routes):
            route = len(frames)
            first = route * scene.frames_per_route
            number = first + np.arange(scene.frames_per_route)
            frames.append(
                pd.DataFrame(
                    {
                        "scene": scene.name,
                        "frame": number,
                        "timestamp_s": traffic.time_s,
                        "route": route,
                        "split": _split(scene, part),
                    }
                )
            )
            boxes.append(boxes_around(traffic, pairs, ego, scene.name, part, first))
    return BoxLog(
        pd.concat(boxes, ignore_index=True)[list(BOX_COLUMNS)],
        pd.concat(frames, ignore_index=True)[list(FRAME_COLUMNS)],
    )


def drive(scene: SumoScene, town: int) -> Trajectories:
    """Traffic of town 0 (training) or 1 (test), with seeds of its own."""
    from sumolib.net import readNet

    layout, demand_seed, driving = np.random.SeedSequence((scene.seed, town)).spawn(3)
    with tempfile.TemporaryDirectory(prefix="lidarplace-") as name:
        folder = Path(name)
        network = build_town(_integer(layout), folder)
        demand = folder / "demand.rou.xml"
        users = write_demand(
            readNet(str(network)),
            scene.density,
            scene.pedestrians,
            scene.seconds,
            np.random.default_rng(demand_seed),
            demand,
        )
        return simulate(scene, network, demand, users, _integer(driving))


def _integer(seed: np.random.SeedSequence) -> int:
    """A seed for SUMO's tools, which take 31 bits."""
    return int(seed.generate_state(1)[0] >> 1)


def choose_egos(traffic: Trajectories, count: int) -> list[int]:
    """Indices of the `count` cars that drove farthest, of those always on the road.

    A standing ego gives near-duplicates of one frame, so movement decides. Sorted by index.

    Raises:
        ValueError: fewer cars stayed on the road.
    """
    car = np.array([user.kind is CAR for user in traffic.users])
    stayed = car & ~np.isnan(traffic.pose[:, :, 0]).any(axis=0)
    candidates = np.flatnonzero(stayed)
    if len(candidates) < count:
        raise ValueError(
            f"only {len(candidates)} cars stayed on the road for the whole recording, "
            f"{count} are needed as egos: ask for fewer routes or more vehicles"
        )
    distance = traffic.speed[:, candidates].sum(axis=0)
    return sorted(candidates[np.argsort(-distance, kind="stable")[:count]].tolist())


def _split(scene: SumoScene, part: str) -> NDArray[np.str_]:
    if scene.split == "route":
        return np.full(scene.frames_per_route, part)
    tenth = np.arange(scene.frames_per_route) % TEST_EVERY == TEST_EVERY - 1
    return np.where(tenth, "test", "train")


def boxes_around(
    traffic: Trajectories,
    pairs: NDArray[np.int64],
    ego: int,
    scene: str,
    part: str,
    first_frame: int,
) -> pd.DataFrame:
    """Boxes within `KEEP_M` of the ego, in its frame.

    Of two that overlap the smaller is left out: SUMO lets some road users brush each other where
    lanes and crossings meet, about one pair in twenty frames of a whole town.
    """
    offset = traffic.pose - traffic.pose[:, ego : ego + 1]
    heading = traffic.pose[:, ego, 2][:, None]
    near = np.hypot(offset[:, :, 0], offset[:, :, 1]) <= KEEP_M  # False where NaN
    near[:, ego] = False
    area = np.array([u.length * u.width for u in traffic.users])
    area[ego] = np.inf
    frame, a, b = pairs.T
    near[frame, np.where(area[a] < area[b], a, b)] = False
    frame, user = np.nonzero(near)
    cos, sin = np.cos(heading), np.sin(heading)
    size = np.array([(u.length, u.width, u.height) for u in traffic.users])[user]
    return pd.DataFrame(
        {
            "scene": scene,
            "frame": first_frame + frame,
            "timestamp_s": traffic.time_s[frame],
            "object_id": np.array([f"{part}-{u.id}" for u in traffic.users])[user],
            "class": np.array([u.kind.object_class for u in traffic.users])[user],
            "x": (cos * offset[:, :, 0] + sin * offset[:, :, 1])[near],
            "y": (cos * offset[:, :, 1] - sin * offset[:, :, 0])[near],
            "z": size[:, 2] / 2,
            "length": size[:, 0],
            "width": size[:, 1],
            "height": size[:, 2],
            "yaw": _wrap(offset[:, :, 2][near]),
        }
    )


def _wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)
