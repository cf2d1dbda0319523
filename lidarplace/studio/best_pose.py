"""Best pose of one LiDAR of a rig, or of one more, while all others stay where they are."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from itertools import chain

import numpy as np
from scipy.stats import qmc

from lidarplace.mounting.limits import MICROMETRE, Limits, MountedSensors, check
from lidarplace.mounting.zone import Zone, distance, position
from lidarplace.recall.choice import RecallChoice
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.studio.numbers import Meter, thinned
from lidarplace.studio.rig import Rig, added, pose_of, posed, removed
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.studio.turns import allowed_turns, beyond
from lidarplace.studio.violations import model_names, requirement_results, totals_above, violations

ROUNDS = 4
PER_ROUND = 32
"""Poses that are tried in each round and zone; each round looks half as far around the best."""
CHECKED = 4
"""Number of poses of a round, those that find most, whose requirements are checked in turn."""
TURN_DEG = (10.0, 20.0, 20.0)
"""Range of roll, pitch and yaw in the first round, degrees."""
ANY_HEADING_DEG = (10.0, 20.0, 180.0)
"""Range of angles of one more LiDAR that does not look all around, degrees."""
AROUND_M = 0.4
"""Distance to each side that a LiDAR goes without zones, and above the body one more, metres."""
LEAST_DISTANCE_M = 1e-3
"""Least distance between two LiDARs, whatever the file allows."""
RAYS = 20_000
"""Rays of a LiDAR in a frame while poses are compared."""


@dataclass(frozen=True)
class BestPose:
    """A pose of a LiDAR in tenths of a degree and, where the zone has one, whole millimetres.

    `before` and `after` are means of `expected_recall` over classes, of all rays; `broken` are
    limits and names of requirements that poses which seem to find more would break."""

    mount: Mount
    before: float
    after: float
    broken: tuple[str, ...]


class KeptLimits:
    """Limits and requirements of a file that a rig keeps."""

    def __init__(self, rig: Rig, file: RigsFile) -> None:
        self._file = file
        self._broken = {(broken.limit, broken.lidars) for broken in violations(rig, file)}
        results = requirement_results(rig, file, file.layouts)
        met = {result.requirement.name for result in results if result.met}
        self._met = [layout for layout in file.layouts if layout.requirement.name in met]

    def broken_by(self, rig: Rig) -> tuple[str, ...]:
        """Return names of what held and does not under another rig with the same LiDARs.

        Requirements, which take longest, are checked if all else is kept."""
        now = violations(rig, self._file)
        broken = [
            result.limit for result in now if (result.limit, result.lidars) not in self._broken
        ]
        if broken or not self._met:
            return tuple(dict.fromkeys(broken))
        met = {
            result.requirement.name
            for result in requirement_results(rig, self._file, self._met)
            if result.met
        }
        names = (layout.requirement.name for layout in self._met)
        return tuple(name for name in names if name not in met)


def improved(rig: Rig, number: int, file: RigsFile, meter: Meter) -> BestPose:
    """Look for the pose of a LiDAR with which the rig finds most.

    Rounds of poses from a Sobol sequence, in the nearest zone and some degrees around, are compared
    with few rays; the best is kept only if it is better with all. What the file does not allow of a
    single LiDAR is not tried, and what breaks a limit or a requirement that holds is not chosen.
    Raises ValueError: no object counts, or two LiDARs are in one place."""
    search = _Search(rig, number, file, meter, KeptLimits(rig, file))
    old = rig.mounts[number]
    around = ((value - AROUND_M, value + AROUND_M) for value in old.position.tolist())
    zone = _nearest(file.zones, old) if file.zones else Zone.box("around", *around)
    first = search.best([old, *search.around(old, zone, 0, TURN_DEG)]) or old
    best = search.refined(first, (zone,), TURN_DEG)
    before, after = search.recall_at(old), search.recall_at(best)
    if after <= before:
        best, after = old, before
    return BestPose(best, before, after, search.broken)


def best_addition(rig: Rig, model: str | None, file: RigsFile, meter: Meter) -> BestPose:
    """Look for the pose of one more LiDAR with which the rig finds most, in all zones.

    As `improved`; without zones above the body. Raises ValueError also: the file allows no pose, or
    no more LiDAR."""
    if file.site is not None and not file.zones:
        raise ValueError("a pole could be anywhere; set zones in the file")
    held, wider = KeptLimits(rig, file), added(rig, model)
    before = {one.limit for one in totals_above(rig, file)}
    for one in totals_above(wider, file):
        if one.limit not in before:
            raise ValueError(f"one more LiDAR is too much: {one.text}")
    search = _Search(wider, len(rig.lidars), file, meter, held)
    zones = file.zones or (_above(file),)
    turn = TURN_DEG if search.lidar.full_turn else ANY_HEADING_DEG
    tried = [pose for zone in zones for pose in search.around(Mount(0, 0, 0), zone, 0, turn)]
    first = search.best(tried) if tried else None
    if first is None:
        broken = f" and that keeps {', '.join(search.broken)}" if search.broken else ""
        raise ValueError(f"no pose for one more LiDAR keeps the limits of the file{broken}")
    best = search.refined(first, zones, turn)
    alone = meter.measure(search.others).mean_recall
    return BestPose(best, alone, search.recall_at(best), search.broken)


def _nearest(zones: Sequence[Zone], mount: Mount) -> Zone:
    return min(zones, key=lambda zone: distance(zone, mount.x, mount.y, mount.z))


def _above(file: RigsFile) -> Zone:
    """Return the zone on and above the middle of the body."""
    extents = file.vehicle.body.extents
    low = extents[:, 0].min(axis=0, initial=0.0).tolist()
    high = extents[:, 1].max(axis=0, initial=0.0).tolist()
    return Zone.box("above", (low[0], high[0]), (low[1], high[1]), (high[2], high[2] + AROUND_M))


@dataclass(frozen=True)
class _Search:
    """Search for the pose of LiDAR `number` of a rig, under which `held` still holds."""

    rig: Rig
    number: int
    file: RigsFile
    meter: Meter
    held: KeptLimits
    _breaks: dict[Mount, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.meter.recall.objects.table.empty:
            raise ValueError("no object of the log counts, so every pose finds the same")

    @cached_property
    def lidar(self) -> Lidar:
        """Model of the LiDAR."""
        return self.rig.models(self.file.lidar)[self.number]

    @property
    def model_name(self) -> str | None:
        """Name of the model in the catalogue; None without."""
        return model_names(self.rig, self.file)[self.number]

    @cached_property
    def others(self) -> Placement | None:
        """Other LiDARs that work; None without any."""
        return removed(self.rig, self.number).placement(self.file.lidar)

    def refined(self, best: Mount, zones: Sequence[Zone], turn: tuple[float, ...]) -> Mount:
        """Return the best after further rounds around the best of the first."""
        zone = _nearest(zones, best)
        for number in range(1, ROUNDS):
            best = self.best([best, *self.around(best, zone, number, turn)]) or best
        return best

    def around(
        self, best: Mount, zone: Zone, number: int, turn: tuple[float, ...]
    ) -> Iterator[Mount]:
        """Yield allowed poses of a round; of the first in the whole zone, then around the best."""
        reach = 0.5**number
        for draw in qmc.Sobol(6, rng=number).random(PER_ROUND):
            at = np.array(position(zone, *draw[:3]))
            at = best.position + reach * (at - best.position) if number else at
            angles = np.degrees(astuple(best)[3:]) + reach * np.array(turn) * (2 * draw[3:] - 1)
            turns = allowed_turns(self.file, zone.name, self.model_name, at[1])
            angles = np.fmod((angles.round(1) - beyond(angles.round(1), turns)).round(6), 360)
            in_mm = at.round(3)
            at = in_mm if distance(zone, *in_mm) <= MICROMETRE else at.round(6)
            pose = Mount.degrees(*at.tolist(), *angles.tolist())
            if distance(zone, *at) <= MICROMETRE and self._allowed(pose):  # it may be not convex
                yield pose

    def _allowed(self, pose: Mount) -> bool:
        """Return whether a pose keeps the limits of a single LiDAR and its distance from others."""
        if self.file.blocked(self.number, pose.position):
            return False
        limits, models = self.file.limits, self.rig.models(self.file.lidar)
        mounts = [*self.rig.mounts]
        mounts[self.number] = pose
        apart = Limits(distance=max(limits.distance or 0.0, LEAST_DISTANCE_M))
        close = check(MountedSensors(mounts, models), apart, self.file.body)
        if any(self.number in violation.lidars for violation in close):
            return False
        alone = replace(limits, zones=(), distance=None, common_view=None, facing=None)
        return not check(MountedSensors([pose], [self.lidar]), alone, self.file.body)

    def best(self, tried: Sequence[Mount]) -> Mount | None:
        """Return the pose that adds most, with few rays, and breaks nothing that held.

        None if all of the first CHECKED break something."""
        pairs = [(mount, self.lidar) for mount in tried]
        if self.others is not None:
            pairs += zip(self.others.mounts, self.others.lidars, strict=True)
        alone = [Placement("one", [mount], lidar=lidar) for mount, lidar in pairs]
        seen = self.meter.recall.objects.seen_by([thinned(one, RAYS) for one in alone])
        weights = dict.fromkeys(self.meter.recall.classes, 1.0)
        choice = RecallChoice(self.meter.recall, seen, weights)
        gains = choice.gains(range(len(tried), len(alone)))[: len(tried)]
        for number in np.argsort(-gains, kind="stable")[:CHECKED].tolist():
            pose: Mount = tried[number]
            if pose not in self._breaks:
                self._breaks[pose] = self.held.broken_by(self._with(pose))
            if not self._breaks[pose]:
                return pose
        return None

    @property
    def broken(self) -> tuple[str, ...]:
        """Limits that poses which find more have broken, in order."""
        return tuple(dict.fromkeys(chain.from_iterable(self._breaks.values())))

    def recall_at(self, mount: Mount) -> float:
        """Return the mean recall of the rig with the LiDAR in that pose, with all rays."""
        return self.meter.measure(self._with(mount).placement(self.file.lidar)).mean_recall

    def _with(self, mount: Mount) -> Rig:
        return posed(self.rig, self.number, **pose_of(mount))
