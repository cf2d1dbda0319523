"""Drive the traffic of a town in SUMO and keep where everybody was."""

import contextlib
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.scenes.routes import STEP_S
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.scenes.sumo.traffic import PEDESTRIAN, SPARE, Demand, RoadUser

LATERAL_RESOLUTION_M = 0.8  # width of a sublane; narrower costs time
TELEPORT_S = 120
"""A vehicle that is stuck for so long is put elsewhere on its route: a jam never freezes a town."""
LEVEL_M = 3.0  # road users whose ground differs more in height are on different levels of a bridge
CHECK_STEPS = round(2 / STEP_S)  # steps between looks at who waits
PATIENCE_S = 30.0
"""A vehicle that has stood for so long takes another way; most red lights are shorter."""


@dataclass(frozen=True)
class Trajectories:
    """Places of road users at every recorded step, in the town's frame; NaN while off the road."""

    users: list[RoadUser]  # sorted by id; U of them
    time_s: NDArray[np.float64]  # seconds since the end of the warm-up, shape (F,)
    pose: NDArray[np.float64]  # x, y of the box's centre and yaw from the x axis, shape (F, U, 3)
    z: NDArray[np.float64]  # height of the road under the user, metres, shape (F, U)
    speed: NDArray[np.float64]  # metres per second, shape (F, U)


def simulate(
    scene: SumoScene, network: Path, demand: Demand, routes: Path, seed: int
) -> Trajectories:
    """Run the traffic of `demand`, written to `routes`, and record `scene.frames_per_route` steps.

    Raises ValueError if the town has no room for so many vehicles, or SUMO cannot read the network,
    RuntimeError if a simulation already runs in this process: SUMO has room for one."""
    import libsumo

    if libsumo.isLoaded():
        raise RuntimeError("a SUMO simulation already runs in this process; close it first")
    users = demand.users
    index = {user.id: u for u, user in enumerate(users)}
    # x, y, z, angle and speed as SUMO returns them.
    state: NDArray[np.float64] = np.full((scene.frames_per_route, len(users), 5), np.nan)
    last = scene.warmup_steps + scene.frames_per_route * scene.frame_stride
    rng = np.random.default_rng(seed)
    with _silent():
        libsumo.start(_command(network, routes, seed))
        try:
            for step in range(1, last + 1):
                libsumo.simulationStep()
                if step % CHECK_STEPS == 0:
                    _reroute(demand, SPARE * scene.seconds, rng)
                frame, rest = divmod(step - scene.warmup_steps, scene.frame_stride)
                if rest or frame < 1:
                    continue
                if frame == 1 and (waiting := libsumo.simulation.getPendingVehicles()):
                    problem = f"no room in the town for {len(waiting)} of {scene.density} vehicles "
                    fix = "ask for fewer or for a longer warm-up"
                    raise InputError(f"{problem}before the first frame", key="density", fix=fix)
                for domain in (libsumo.vehicle, libsumo.person):
                    for user in domain.getIDList():
                        motion = domain.getAngle(user), domain.getSpeed(user)
                        state[frame - 1, index[user]] = (*domain.getPosition3D(user), *motion)
        finally:
            libsumo.close()
    state[state[:, :, 0] == libsumo.constants.INVALID_DOUBLE_VALUE] = np.nan  # see TELEPORT_S
    # Degrees clockwise from north -> radians counterclockwise from x.
    yaw = math.pi / 2 - np.radians(state[:, :, 3])
    # Vehicles report the middle of their front bumper, pedestrians their centre.
    back = np.array([0.0 if u.kind is PEDESTRIAN else u.length / 2 for u in users])
    x, y = state[:, :, 0] - back * np.cos(yaw), state[:, :, 1] - back * np.sin(yaw)
    time_s = np.arange(scene.frames_per_route, dtype=np.float64) * (scene.frame_stride * STEP_S)
    pose = np.stack([x, y, yaw], axis=2)
    return Trajectories(users, time_s, pose, state[:, :, 2], state[:, :, 4])


def _command(network: Path, routes: Path, seed: int) -> list[str]:
    return [
        *("sumo", "--net-file", str(network), "--route-files", str(routes)),
        *("--step-length", str(STEP_S), "--seed", str(seed)),
        *("--lateral-resolution", str(LATERAL_RESOLUTION_M)),
        *("--time-to-teleport", str(TELEPORT_S)),
        *("--collision.action", "teleport", "--collision.check-junctions"),
        *("--no-warnings", "--no-step-log", "--duration-log.disable", "--xml-validation", "never"),
    ]


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Send what C++ code writes to standard output and error to nowhere; errors are raised."""
    null = os.open(os.devnull, os.O_WRONLY)
    copies = [os.dup(stream) for stream in (1, 2)]
    try:
        for stream in (1, 2):
            os.dup2(null, stream)
        yield
    finally:
        for stream, copy in zip((1, 2), copies, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(null)


def _reroute(demand: Demand, seconds: float, rng: np.random.Generator) -> None:
    """Give vehicles that wait a new random walk from where they are."""
    import libsumo

    classes = {user.id: user.kind.sumo_class for user in demand.users}
    for vehicle in sorted(libsumo.vehicle.getIDList()):
        if libsumo.vehicle.getWaitingTime(vehicle) >= PATIENCE_S:
            graph = demand.drives[classes[vehicle]]
            lane = graph.index.get(libsumo.vehicle.getLaneID(vehicle))
            if lane is not None:  # not within a junction
                libsumo.vehicle.setRoute(vehicle, list(graph.walk(seconds, rng, lane)))
