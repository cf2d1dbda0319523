"""The best pose of one LiDAR of a rig, or of one more, all others staying where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.vehicle import depth_in_body
from lidarplace.mounting.zone import Zone, distance, position
from lidarplace.placement import Mount, Placement
from lidarplace.recall.choice import RecallChoice
from lidarplace.sensor import Lidar
from lidarplace.studio.numbers import Meter, thinned
from lidarplace.studio.rigs_file import RigsFile

ROUNDS = 4
PER_ROUND = 32
"""Poses that are tried in each round and zone; each round looks half as far around the best."""
TURN_DEG = (10.0, 20.0, 20.0)
"""How far roll, pitch and yaw go in the first round."""
ANY_HEADING_DEG = (10.0, 20.0, 180.0)
"""The same of one more LiDAR that does not look all around."""
AROUND_M = 0.4
"""How far a LiDAR goes to each side where there are no zones, and how far above the body one more
is looked for."""
RAYS = 20_000
"""Of a LiDAR in a frame while poses are compared."""


@dataclass(frozen=True)
class BestPose:
    """Where a LiDAR goes.

    Attributes:
        mount: the pose, in whole millimetres and tenths of a degree; the old one if none is better.
        before, after: mean of `expected_recall` over the classes that there are, of all rays.
    """

    mount: Mount
    before: float
    after: float


def improved(
    lidar: Lidar, old: Mount, others: Placement | None, file: RigsFile, meter: Meter
) -> BestPose:
    """Look for the pose of a LiDAR with which the rig finds most.

    Rounds of poses from a Sobol sequence, in the zone in which it is (or which is nearest) and
    some degrees around, are compared with few rays; the best is kept only if it is better with
    all. What the file does not allow of a single LiDAR is not tried.

    Args:
        lidar, old: its model, and where it is.
        others: LiDARs of the rig beside it; None without any.

    Raises:
        ValueError: no object counts.
    """
    at = old.x, old.y, old.z
    if file.zones:
        zone = min(file.zones, key=lambda zone: distance(zone, *at))
    else:
        zone = Zone.box("around", *((value - AROUND_M, value + AROUND_M) for value in at))
    search = _Search(lidar, others, file, meter)
    best = search.refined([old, *search.around(old, zone, 0, TURN_DEG)], (zone,), TURN_DEG)
    before, after = _found(others, lidar, old, meter), _found(others, lidar, best, meter)
    return BestPose(best, before, after) if after > before else BestPose(old, before, before)


def best_addition(lidar: Lidar, others: Placement | None, file: RigsFile, meter: Meter) -> BestPose:
    """Look for the pose of one more LiDAR with which the rig finds most, in all zones.

    As `improved` does; without zones above the body.

    Raises:
        ValueError: nowhere is a place for it, or no object counts.
    """
    zones = file.zones or (_above(file),)
    turn = TURN_DEG if lidar.full_turn else ANY_HEADING_DEG
    search = _Search(lidar, others, file, meter)
    first = [pose for zone in zones for pose in search.around(Mount(0, 0, 0), zone, 0, turn)]
    if not first:
        raise ValueError("no pose was found that the file allows for one more LiDAR")
    best = search.refined(first, zones, turn)
    before = meter.measure(others).mean_recall
    return BestPose(best, before, _found(others, lidar, best, meter))


def _above(file: RigsFile) -> Zone:
    """On and above the middle of the body."""
    low = file.vehicle.extents[:, 0].min(axis=0, initial=0.0).tolist()
    high = file.vehicle.extents[:, 1].max(axis=0, initial=0.0).tolist()
    return Zone.box("above", (low[0], high[0]), (low[1], high[1]), (high[2], high[2] + AROUND_M))


@dataclass(frozen=True)
class _Search:
    """For the pose of one LiDAR."""

    lidar: Lidar
    others: Placement | None
    file: RigsFile
    meter: Meter

    def __post_init__(self) -> None:
        if self.meter.recall.objects.table.empty:
            raise ValueError("in the log no object counts; there is nothing to find")

    def refined(
        self, tried: Sequence[Mount], zones: Sequence[Zone], turn: tuple[float, ...]
    ) -> Mount:
        """The best after further rounds around the best of `tried`."""
        best = self._best(tried)
        zone = min(zones, key=lambda zone: distance(zone, best.x, best.y, best.z))
        for number in range(1, ROUNDS):
            best = self._best([best, *self.around(best, zone, number, turn)])
        return best

    def around(
        self, best: Mount, zone: Zone, number: int, turn: tuple[float, ...]
    ) -> Iterator[Mount]:
        """Allowed poses of a round; of the first in the whole zone, then around the best."""
        reach = 0.5**number
        for draw in qmc.Sobol(6, rng=number).random(PER_ROUND):
            at = np.array(position(zone, *draw[:3]))
            at = best.position + reach * (at - best.position) if number else at
            angles = np.degrees(astuple(best)[3:]) + reach * np.array(turn) * (2 * draw[3:] - 1)
            pose = Mount.degrees(*at.round(3).tolist(), *angles.round(1).tolist())
            if distance(zone, *pose.position) <= 1e-3 and self._allowed(pose):
                yield pose  # a millimetre outside by rounding, or more if it is not convex

    def _allowed(self, pose: Mount) -> bool:
        limits, at = self.file.settings.constraints, pose.position
        if depth_in_body(self.file.body, at[None])[0] > 0:
            return False
        others = () if self.others is None else self.others.mounts
        apart = min((math.dist(at, other.position) for other in others), default=math.inf)
        if apart < max(limits.distance, 1e-3):
            return False
        share = limits.body_share
        return share is None or body_share(pose, self.lidar, self.file.body) <= share

    def _best(self, tried: Sequence[Mount]) -> Mount:
        """The one that adds most to the other LiDARs, with few rays."""
        alone = [Placement("one", [mount], lidar=self.lidar) for mount in tried]
        if self.others is not None:
            pairs = zip(self.others.mounts, self.others.lidars, strict=True)
            alone += [Placement("one", [mount], lidar=lidar) for mount, lidar in pairs]
        seen = self.meter.recall.objects.seen_by([thinned(one, RAYS) for one in alone])
        weights = dict.fromkeys(self.meter.recall.classes, 1.0)
        choice = RecallChoice(self.meter.recall, seen, weights)
        gains: NDArray[np.float64] = choice.gains(range(len(tried), len(alone)))
        return tried[int(np.argmax(gains[: len(tried)]))]


def _found(others: Placement | None, lidar: Lidar, mount: Mount, meter: Meter) -> float:
    mounts, lidars = [mount], [lidar]
    if others is not None:
        mounts, lidars = [*others.mounts, mount], [*others.lidars, lidar]
    return meter.measure(Placement("rig", mounts, lidar=lidars)).mean_recall
