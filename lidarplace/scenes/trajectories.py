"""Drive the traffic of a town in SUMO and keep where everybody was."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.scenes.settings import STEP_S, SumoScene
from lidarplace.scenes.traffic import PEDESTRIAN, RoadUser

LATERAL_RESOLUTION_M = 0.8
"""Width of a sublane; narrower costs time."""

TELEPORT_S = 40
"""A vehicle that is stuck for so long is put elsewhere on its route: a jam never freezes a town."""


@dataclass(frozen=True)
class Trajectories:
    """Where every road user was at every recorded step, in the town's frame.

    Attributes:
        users: the road users, sorted by id; U of them.
        time_s: seconds since the end of the warm-up, shape (F,), float64.
        pose: x, y of the box's centre and yaw from the x axis, shape (F, U, 3), float64, metres
            and radians; NaN while a user is not on the road.
        speed: metres per second, shape (F, U), float64, NaN likewise.
    """

    users: list[RoadUser]
    time_s: NDArray[np.float64]
    pose: NDArray[np.float64]
    speed: NDArray[np.float64]


def simulate(
    scene: SumoScene, network: Path, demand: Path, users: list[RoadUser], seed: int
) -> Trajectories:
    """Run the traffic of `demand` through `network` and record `scene.frames_per_route` steps.

    Raises:
        ValueError: the town has no room for so many vehicles.
        RuntimeError: a simulation already runs in this process; SUMO has room for one.
    """
    import libsumo

    if libsumo.isLoaded():
        raise RuntimeError("a SUMO simulation already runs in this process; close it first")
    index = {user.id: u for u, user in enumerate(users)}
    half_length = np.array([user.length / 2 for user in users], np.float64)
    pose: NDArray[np.float64] = np.full((scene.frames_per_route, len(users), 3), np.nan)
    speed = np.full((scene.frames_per_route, len(users)), np.nan)
    with _silent():
        libsumo.start(_command(network, demand, seed))
        try:
            for _ in range(scene.warmup_steps):
                libsumo.simulationStep()
            for f in range(scene.frames_per_route):
                for _ in range(scene.frame_stride):
                    libsumo.simulationStep()
                if f == 0 and (waiting := libsumo.simulation.getPendingVehicles()):
                    raise ValueError(
                        f"density {scene.density}: {len(waiting)} vehicles found no room in the "
                        "town before the first frame; ask for fewer or for a longer warm-up"
                    )
                for domain in (libsumo.vehicle, libsumo.person):
                    for user in domain.getIDList():
                        u = index[user]
                        x, y = domain.getPosition(user)
                        if x == libsumo.constants.INVALID_DOUBLE_VALUE:
                            continue  # between two places, see TELEPORT_S
                        # Degrees clockwise from north -> radians counterclockwise from x.
                        pose[f, u] = x, y, math.pi / 2 - math.radians(domain.getAngle(user))
                        speed[f, u] = domain.getSpeed(user)
        finally:
            libsumo.close()
    # Vehicles report the middle of their front bumper, pedestrians their centre.
    half_length[[user.kind is PEDESTRIAN for user in users]] = 0.0
    pose[:, :, 0] -= half_length * np.cos(pose[:, :, 2])
    pose[:, :, 1] -= half_length * np.sin(pose[:, :, 2])
    time_s = np.arange(scene.frames_per_route, dtype=np.float64) * (scene.frame_stride * STEP_S)
    return Trajectories(users, time_s, pose, speed)


def _command(network: Path, demand: Path, seed: int) -> list[str]:
    return [
        *("sumo", "--net-file", str(network), "--route-files", str(demand)),
        *("--step-length", str(STEP_S), "--seed", str(seed)),
        *("--lateral-resolution", str(LATERAL_RESOLUTION_M)),
        *("--time-to-teleport", str(TELEPORT_S)),
        *("--collision.action", "teleport", "--collision.check-junctions"),
        *("--no-warnings", "--no-step-log", "--duration-log.disable", "--xml-validation", "never"),
    ]


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Send what C++ code writes to standard output and error to nowhere.

    Not for errors: libsumo raises those with their message.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    kept = [os.dup(stream) for stream in (1, 2)]
    try:
        for stream in (1, 2):
            os.dup2(null, stream)
        yield
    finally:
        for stream, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(null)
