"""Limits of mounting and their excess: one rule for searches, studio and cautions."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.common_view import CommonView, common_view, weakest
from lidarplace.mounting.facing import facing_pairs
from lidarplace.mounting.housing import housings_of, without
from lidarplace.mounting.vehicle import Vehicle, depth_in, depth_in_body
from lidarplace.mounting.zone import Zone, distance
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

ROUNDING = 1e-9
"""Largest excess that rounding explains: 0.6 - 0.4 is not quite 0.2."""
MICROMETRE = 1e-6
"""Largest distance from a zone that counts as on its edge, metres."""


class MountedSensors(NamedTuple):
    """Sensors of a rig that may break limits, such as two LiDARs in one place.

    Attributes:
        mounts: poses of the LiDARs.
        lidars: models of the LiDARs, one a mount.
        further: cameras and radars.
        dead: LiDARs that see nothing and hide what is behind them."""

    mounts: Sequence[Mount]
    lidars: Sequence[Lidar]
    further: Sequence[MountedSensor] = ()
    dead: Sequence[tuple[Mount, Lidar]] = ()

    @property
    def placement(self) -> Placement | None:
        """LiDARs as a placement; None without a LiDAR, or with two in one place."""
        try:
            return Placement("rig", self.mounts, self.lidars, self.dead)
        except ValueError:
            return None


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of mounting; None, no zone and no box leave their limit out.

    Attributes:
        zones: allowed positions; each LiDAR must be in one of them.
        body: vehicle without `keep_out`; no LiDAR may be inside.
        keep_out: further boxes without a LiDAR, lower and upper corners, metres, shape (n, 2, 3).
        distance: least distance between two LiDARs, metres; with 0 they must differ.
        body_share: largest share of a LiDAR's rays that may meet the vehicle or another LiDAR.
        common_view: what pairs of sensors must see in common.
        facing: largest number of pairs of LiDARs that may look into each other."""

    zones: Sequence[Zone] = ()
    body: Vehicle | None = None
    keep_out: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2, 3)))
    distance: float | None = None
    body_share: float | None = None
    common_view: CommonView | None = None
    facing: int | None = None

    @property
    def bounds(self) -> dict[str, float]:
        """Bound of each limit that is set, by its name, in the order in which they are checked."""
        bounds = {
            "zone": 0.0 if self.zones else None,
            "body": None if self.body is None else 0.0,
            "keep_out": 0.0 if len(self.keep_out) else None,
            "distance": self.distance,
            "body_share": self.body_share,
            "common_view": None if self.common_view is None else self.common_view.share,
            "facing": self.facing,
        }
        return {name: float(bound) for name, bound in bounds.items() if bound is not None}


@dataclass(frozen=True)
class Violation:
    """A limit that a rig exceeds.

    Attributes:
        limit: name of the limit, a field of `Limits`, or "zone".
        lidars: numbers of the LiDARs concerned, from 0; in a common view cameras and radars follow
            them, then sensors that are missing.
        value: measured value, in metres, a share, or a number of pairs.
        excess: how far the value is beyond the bound, in the same unit."""

    limit: str
    lidars: tuple[int, ...]
    value: float
    excess: float


def check(rig: MountedSensors, limits: Limits, vehicle: Vehicle) -> list[Violation]:
    """Return the limits that a rig exceeds; `vehicle` hides objects, with its keep-outs."""
    violations = []
    for name, bound in limits.bounds.items():
        for lidars, value in _measure(name, rig, limits, vehicle):
            by = excess(value, bound, at_least=name in _LOWER_BOUNDS)
            tolerance = MICROMETRE if name == "zone" else 0.0
            if by > tolerance or (name == "distance" and value == 0):
                violations.append(Violation(name, lidars, value, by))
    return violations


def worst(name: str, rig: MountedSensors, limits: Limits, vehicle: Vehicle) -> float:
    """Return the measured value of the limit `name` that is closest to its bound, or beyond it."""
    values = (value for _, value in _measure(name, rig, limits, vehicle))
    return min(values, default=math.inf) if name in _LOWER_BOUNDS else max(values, default=0.0)


def excess(value: float, bound: float, *, at_least: bool) -> float:
    """Return how far a value is beyond a lower or an upper bound; 0 or less if it is not."""
    by = bound - value if at_least else value - bound
    return 0.0 if abs(by) < ROUNDING else by


_LOWER_BOUNDS = {"distance", "common_view"}
"""Limits whose bound is the least value; of all others it is the largest."""


def _measure(
    name: str, rig: MountedSensors, limits: Limits, vehicle: Vehicle
) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield numbers of LiDARs, and what a limit measures of them.

    Pairs are measured in the pose of the vehicle in which they are worst."""
    places = [mount.position for mount in rig.mounts]
    placement = rig.placement if name in ("common_view", "facing") else None
    match name:
        case "zone":
            for number, place in enumerate(places):
                yield (number,), min(distance(zone, *place) for zone in limits.zones)
        case "body" | "keep_out":
            points = np.reshape(places, (-1, 3))
            if name == "keep_out":
                depths = depth_in(limits.keep_out, points)
            else:
                depths = depth_in_body(limits.body or vehicle, points)
            yield from (((number,), depth) for number, depth in enumerate(depths.tolist()))
        case "distance":
            for i, j in combinations(range(len(places)), 2):
                yield (i, j), math.dist(places[i], places[j])
        case "body_share":
            housings = housings_of(rig.mounts, rig.lidars)
            for number, (mount, lidar) in enumerate(zip(rig.mounts, rig.lidars, strict=True)):
                others = without(housings, number)
                yield (number,), body_share(mount, lidar, vehicle, others=others)
        case "common_view" if placement is not None and (view := limits.common_view) is not None:
            poses = vehicle.poses.values()
            shares = (common_view(placement, pose, view, rig.further) for pose in poses)
            share, pair = min((weakest(each, view) for each in shares), key=lambda least: least[0])
            yield pair or (), share
        case "facing" if placement is not None:
            poses = vehicle.poses.values()
            pairs = max((facing_pairs(placement, pose) for pose in poses), key=len)
            yield from ((pair, float(len(pairs))) for pair in pairs)
