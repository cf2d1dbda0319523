"""Which cars of a simulation are egos: those that meet many others."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.scenes.sumo.traffic import CAR
from lidarplace.scenes.sumo.trajectories import LEVEL_M, Trajectories

MEETS_M = 40.0
"""Who comes so near has been met: as far as the paper's ROI reaches ahead."""

FASTEST_M_S = 30.0
LEAP_M = 5.0
"""A car that gets farther than it can drive, and than a bend of its road explains, was moved."""


def choose_egos(traffic: Trajectories, count: int) -> list[int]:
    """Indices of `count` of the cars that were on the road all the time, sorted.

    Frames of one road user are alike, so a log says the more, the more of them it holds. Egos are
    added one after the other, each the one that most increases the sum over all road users of
    ln(1 + frames in which an ego meets them): one near another ego, or in a queue with the same
    few, adds little. The sum is submodular, so it reaches at least 1 - 1/e of what any choice has.
    Cars that drove less than half the median are the last choice, since a standing ego gives
    near-duplicates of one frame. A car that SUMO put elsewhere is no ego.

    Raises:
        ValueError: fewer cars stayed on the road.
    """
    car = np.array([user.kind is CAR for user in traffic.users])
    hops = np.hypot(*np.diff(traffic.pose[:, :, :2], axis=0).transpose(2, 0, 1))
    leap = LEAP_M + FASTEST_M_S * np.diff(traffic.time_s)[:, None]
    stayed = car & ~np.isnan(traffic.pose[:, :, 0]).any(axis=0) & (hops <= leap).all(axis=0)
    candidates = np.flatnonzero(stayed)
    if len(candidates) < count:
        raise ValueError(
            f"only {len(candidates)} cars stayed on the road for the whole recording, "
            f"{count} are needed as egos: ask for fewer routes or more vehicles"
        )
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
    """In how many frames each road user is within `MEETS_M` of the ego; shape (U,)."""
    x, y = (traffic.pose[:, :, :2] - traffic.pose[:, ego : ego + 1, :2]).transpose(2, 0, 1)
    near = np.hypot(x, y) <= MEETS_M  # False where NaN
    near &= np.abs(traffic.z - traffic.z[:, ego : ego + 1]) <= LEVEL_M
    near[:, ego] = False
    return np.asarray(near.sum(axis=0))
