"""Vehicles that wait long take another way."""

import numpy as np

from lidarplace.scenes.routes import STEP_S
from lidarplace.scenes.sumo.traffic import SPARE, Demand

CHECK_STEPS = round(2 / STEP_S)
"""Steps between looks at who waits."""

PATIENCE_S = 30.0
"""A vehicle that has stood for so long takes another way; most red lights are shorter."""


class Rerouting:
    """Call it after every step: it gives those who wait a new random walk from where they are."""

    def __init__(self, demand: Demand, seconds: float, rng: np.random.Generator) -> None:
        self._graphs = {
            user.id: demand.drives[user.kind.sumo_class]
            for user in demand.users
            if user.kind.sumo_class in demand.drives
        }
        self._seconds = SPARE * seconds
        self._rng = rng
        self._steps = 0

    def __call__(self) -> None:
        import libsumo

        self._steps += 1
        if self._steps % CHECK_STEPS:
            return
        for vehicle in sorted(libsumo.vehicle.getIDList()):
            if libsumo.vehicle.getWaitingTime(vehicle) < PATIENCE_S:
                continue
            graph = self._graphs[vehicle]
            lane = graph.index.get(libsumo.vehicle.getLaneID(vehicle))
            if lane is not None:  # not within a junction
                libsumo.vehicle.setRoute(vehicle, list(graph.walk(self._seconds, self._rng, lane)))
