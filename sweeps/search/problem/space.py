"""The space of rigs as parameters of Optuna, and back; rigs assigned to its slots.

Positions are shares of a zone, from 0 to 1 along each of its axes: so every combination of values
is a position in the zone, whatever its shape, and the parameters are the same for all zones.
Angles are in degrees. What cannot vary is no parameter."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

from lidarplace import Mount
from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point
from lidarplace.configuration.mounting import Pair, mountable
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.mounting.zone import (
    TOLERANCE,
    Zone,
    distance,
    left_half,
    on_centre_line,
    position,
    shares,
)
from sweeps.configuration.search import SearchSettings
from sweeps.search.problem.rig import MountedLidar, Rig, mirrored, ordered, rounded
from tracking.run_folders import search_json

NUMBER = "lidars"
"""Parameter for the number of LiDARs: of all zones together, or after the name of a zone."""
MOST_COUNTS = 10_000
"""Most ways to divide LiDARs among zones."""
CountsPerZone = tuple[int, ...]
"""Numbers of LiDARs to place: in all zones together, or in each zone that has a number of its own.

A mirrored pair of a zone counts once."""
_ANGLES = ("roll", "pitch", "yaw")
_OFF = 1e-4
"""Radians by which an angle may be outside of its range."""


@dataclass(frozen=True)
class MountSlot:
    """A LiDAR to place, or the left one of a mirrored pair.

    `name` is the prefix of its parameters, such as `lidar_1`; `spans` are of roll, pitch and yaw in
    degrees, ego frame."""

    name: str
    zones: tuple[Zone, ...]
    models: tuple[str, ...]
    spans: Mapping[str, Pair]
    pair: bool

    @property
    def size(self) -> int:
        """Number of LiDARs in the slot."""
        return 2 if self.pair else 1

    def zone(self, name: str) -> Zone:
        """Return the slot's zone of that name."""
        return next(zone for zone in self.zones if zone.name == name)


@dataclass(frozen=True)
class Assignment:
    """A LiDAR, or the left one of a mirrored pair, in a slot, which has a trial's parameters."""

    slot: MountSlot
    lidar: MountedLidar

    @property
    def rig(self) -> Rig:
        """The LiDAR, or both of the mirrored pair."""
        other = replace(self.lidar, mount=mirrored(self.lidar.mount))
        return ordered([self.lidar, other] if self.slot.pair else [self.lidar])


class Space:
    """Rigs that a configuration allows, of LiDAR `models` by name and those that are `fixed`.

    Raises ValueError: no zone is wide enough for symmetry, or there are too many ways to divide
    LiDARs among zones."""

    def __init__(
        self, settings: SearchSettings, models: tuple[str, ...], fixed: Sequence[MountedLidar]
    ) -> None:
        self.settings, self.models, self.fixed = settings, models, ordered(fixed)
        self.zones = mountable(settings.zones, vehicle_of(settings.vehicle))
        if settings.symmetric:
            _check_symmetry(self.zones)
        self.all_counts = self._count_all()

    @cached_property
    def count_ranges(self) -> dict[str, Pair]:
        """Least and greatest number of LiDARs, by the parameter's name."""
        if not self.settings.counted:
            return {NUMBER: self.settings.lidars}
        zones = self.settings.zones.items()
        return {f"{name}.{NUMBER}": zone.lidars for name, zone in zones if zone.lidars}

    def _count_all(self) -> tuple[CountsPerZone, ...]:
        """List all counts per zone, fewest LiDARs first; fixed LiDARs excluded."""
        ways = math.prod(int(high - low) + 1 for low, high in self.count_ranges.values())
        if ways > MOST_COUNTS:
            most, fix = f"at most {MOST_COUNTS:,}", "set ranges of `lidars` in fewer zones"
            problem, key = "too many ways to divide LiDARs", "search.zones"
            raise InputError(problem, key=key, expected=most, found=f"{ways:,}", fix=fix)
        ranges = (range(int(low), int(high) + 1) for low, high in self.count_ranges.values())
        every = itertools.product(*ranges)
        return tuple(sorted(every, key=lambda counts: (self._size(counts), counts)))

    def _size(self, counts: CountsPerZone) -> int:
        return sum(slot.size for slot in self.slots(counts))

    @cached_property
    def numbers(self) -> tuple[int, int]:
        """The least and the greatest number of LiDARs, without the fixed ones."""
        return self._size(self.all_counts[0]), self._size(self.all_counts[-1])

    @property
    def numbers_of_parameters(self) -> tuple[int, int]:
        """The least and the greatest number of parameters of a rig."""
        sizes = [len(self.distributions(counts)) for counts in self.all_counts]
        return min(sizes), max(sizes)

    def slots(self, counts: CountsPerZone) -> list[MountSlot]:
        """Return the slots to fill for these counts."""
        if self.settings.counted:
            slots: list[MountSlot] = []
            for zone, count in zip(self.zones, counts, strict=True):
                of_zone = self.settings.zones[zone.name]
                models, spans = of_zone.models or self.models, self.spans(zone.name)
                kind = ((zone,), models, spans, of_zone.mirrored)
                slots += [MountSlot(f"{zone.name}_{i + 1}", *kind) for i in range(count)]
            return slots
        (number,) = counts
        spans = {name: getattr(self.settings, f"{name}_deg") for name in _ANGLES}
        zones, models = self.zones, self.models
        if not self.settings.symmetric:
            return [MountSlot(f"lidar_{i + 1}", zones, models, spans, False) for i in range(number)]
        halves = tuple(filter(None, map(left_half, zones)))
        names = [f"pair_{i + 1}" for i in range(number // 2)]
        pairs = [MountSlot(name, halves, models, spans, True) for name in names]
        if number % 2 == 0:
            return pairs
        middles = tuple(filter(None, map(on_centre_line, zones)))
        if not middles:
            raise InputError("an odd number needs a zone that meets y = 0", key="search.symmetric")
        upright = spans | {"roll": (0.0, 0.0), "yaw": (0.0, 0.0)}
        return [*pairs, MountSlot("centre", middles, models, upright, False)]

    def spans(self, zone: str) -> dict[str, Pair]:
        """Return lowest and highest roll, pitch and yaw of a mount in a zone; degrees, ego."""
        keys, of_zone = [f"{angle}_deg" for angle in _ANGLES], self.settings.zones[zone]
        roll, pitch, yaw = (getattr(of_zone, key) or getattr(self.settings, key) for key in keys)
        low, high = (of_zone.facing_deg + end for end in yaw)
        return {"roll": roll, "pitch": pitch, "yaw": (low, high)}

    def distributions(self, counts: CountsPerZone) -> dict[str, BaseDistribution]:
        """Return the parameters of a rig with these counts."""
        of_slots = (self.slot_distributions(slot) for slot in self.slots(counts))
        return {name: distribution for slot in of_slots for name, distribution in slot.items()}

    def slot_distributions(self, slot: MountSlot) -> dict[str, BaseDistribution]:
        """Return the parameters of a LiDAR, or of the left one of a pair."""
        distributions: dict[str, BaseDistribution] = {}
        if len(slot.models) > 1:
            distributions["model"] = CategoricalDistribution(slot.models)
        if len(slot.zones) > 1:
            distributions["zone"] = CategoricalDistribution([zone.name for zone in slot.zones])
        for axis, name in enumerate("xyz"):
            if any(_extent(zone)[axis] > 0 for zone in slot.zones):
                distributions[name] = FloatDistribution(0.0, 1.0)
        for name, (low, high) in slot.spans.items():
            if low < high:
                distributions[f"{name}_deg"] = FloatDistribution(low, high)
        return {f"{slot.name}.{name}": distribution for name, distribution in distributions.items()}

    def allowed(self, slot: MountSlot, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters of a slot, within their spans; `values` lack its prefix."""
        parameters = {}
        for name, span in self.slot_distributions(slot).items():
            value = values[name.removeprefix(f"{slot.name}.")]
            parameters[name] = within(value, span) if isinstance(span, FloatDistribution) else value
        return parameters

    def suggest(self, trial: optuna.Trial) -> Rig:
        """Ask a trial for all its parameters, which depend on the number of LiDARs."""
        for name, (low, high) in self.count_ranges.items():
            if low < high:
                trial.suggest_int(name, int(low), int(high))
        for name, distribution in self.distributions(self.counts_per_zone(trial.params)).items():
            if isinstance(distribution, FloatDistribution):
                trial.suggest_float(name, distribution.low, distribution.high)
            else:
                assert isinstance(distribution, CategoricalDistribution)
                trial.suggest_categorical(name, distribution.choices)
        return self.rig(trial.params)

    def counts_per_zone(self, params: Mapping[str, Any]) -> CountsPerZone:
        """Return how many LiDARs these parameters ask for."""
        return tuple(int(params.get(name, low)) for name, (low, _) in self.count_ranges.items())

    def rig(self, params: Mapping[str, Any]) -> Rig:
        """Return the rig of these parameters."""
        lidars = list(self.fixed)
        for slot in self.slots(self.counts_per_zone(params)):
            model = params.get(f"{slot.name}.model", slot.models[0])
            name = params.get(f"{slot.name}.zone", slot.zones[0].name)
            along = (params.get(f"{slot.name}.{axis}", 0.5) for axis in "xyz")
            place = position(slot.zone(name), *along)
            roll, pitch, yaw = (
                math.radians(params.get(f"{slot.name}.{angle}_deg", slot.spans[angle][0]))
                for angle in _ANGLES
            )
            mount = rounded(*place, roll, pitch, math.remainder(yaw, math.tau))
            lidars += Assignment(slot, MountedLidar(model, name, mount)).rig
        return ordered(lidars)

    def params(self, placed: Sequence[Assignment]) -> dict[str, Any]:
        """Return the parameters that give these LiDARs to all slots; the inverse of `rig`."""
        parameters: dict[str, Any] = {}
        for name, (low, high) in self.count_ranges.items():
            if low < high:
                slots = [place.slot for place in placed]
                parameters[name] = (
                    sum(name == f"{slot.zones[0].name}.{NUMBER}" for slot in slots)
                    if self.settings.counted
                    else sum(slot.size for slot in slots)
                )
        for place in placed:
            slot, lidar, mount = place.slot, place.lidar, place.lidar.mount
            along = shares(slot.zone(lidar.zone), mount.x, mount.y, mount.z)
            values: dict[str, Any] = {"model": lidar.model, "zone": lidar.zone}
            values |= zip("xyz", along, strict=True)
            for angle, span in slot.spans.items():
                degrees, centre = math.degrees(getattr(mount, angle)), sum(span) / 2
                # The same direction, less than half a turn from the middle of its span.
                values[f"{angle}_deg"] = degrees - 360 * round((degrees - centre) / 360)
            parameters |= self.allowed(slot, values)
        return parameters


def within(value: float, span: FloatDistribution) -> float:
    """Return the value, or the nearest end of the span."""
    return min(max(value, span.low), span.high)


def _check_symmetry(zones: Sequence[Zone]) -> None:
    """Check that zones right of the centre line mirror those left of it. Raises InputError."""
    shapes = {(frozenset(zone.polygon), zone.z) for zone in zones}
    for zone in zones:
        mirrored_shape = frozenset((x, 0 - y) for x, y in zone.polygon)
        if any(y < 0 for _, y in zone.polygon) and (mirrored_shape, zone.z) not in shapes:
            problem = f"zone {zone.name} is not symmetric to y = 0, nor to another zone"
            raise InputError(problem, key="search.symmetric", fix="define its left part alone")


def _extent(zone: Zone) -> tuple[float, float, float]:
    ys = [y for _, y in zone.polygon]
    return zone.x[1] - zone.x[0], max(ys) - min(ys), zone.z[1] - zone.z[0]


def assign_to_slots(space: Space, lidars: Sequence[MountedLidar]) -> list[Assignment]:
    """Assign each of the LiDARs, without the fixed ones, to a slot of its kind.

    LiDARs without a zone get the first one that holds them, and those without a model its first.
    Raises ValueError: the space has no rigs of so many LiDARs, or one has no slot."""
    least, most = space.numbers
    if not least <= len(lidars) <= most:
        raise InputError(f"has {len(lidars)} LiDARs, more or fewer than search.lidars")
    left: list[MountedLidar] = list(lidars)
    for counts_per_zone in space.all_counts:
        slots = space.slots(counts_per_zone)
        if sum(slot.size for slot in slots) != len(lidars):
            continue
        assignments, left = _in_slots(slots, lidars)
        if not left:
            return assignments
    mount = left[0].mount
    place = point(mount.x, mount.y, mount.z)
    raise InputError(f"no zone or mirrored pair allows a LiDAR at {place} with its angles")


def _in_slots(
    slots: Sequence[MountSlot], lidars: Sequence[MountedLidar]
) -> tuple[list[Assignment], list[MountedLidar]]:
    """Assign LiDARs to slots; return assignments, and LiDARs left if a slot gets none."""
    left, assignments = list(lidars), []
    for slot in slots:
        place = next((p for lidar in left if (p := _in_slot(slot, lidar, left))), None)
        if place is None:
            break
        assignments.append(place)
        for placed in place.rig:
            left.remove(next(lidar for lidar in left if _same(lidar.mount, placed.mount)))
    return assignments, left


def rig_of(placed: Sequence[Assignment], space: Space) -> Rig:
    """Return the rig of these LiDARs and those that every rig has."""
    return ordered([*space.fixed, *(lidar for place in placed for lidar in place.rig)])


def _in_slot(
    slot: MountSlot, lidar: MountedLidar, left: Sequence[MountedLidar]
) -> Assignment | None:
    """Return the LiDAR in that slot; a pair needs its mirrored one among those `left`."""
    mount, model = lidar.mount, lidar.model or slot.models[0]
    if model not in slot.models:
        return None
    if slot.pair:
        other = mirrored(mount)
        if mount.y <= 0 or not any(_same(lidar.mount, other) for lidar in left):
            return None
    for zone in slot.zones:
        if lidar.zone in ("", zone.name) and fits(slot, zone, mount):
            return Assignment(slot, MountedLidar(model, zone.name, mount))
    return None


def fits(slot: MountSlot, zone: Zone, mount: Mount) -> bool:
    """Return whether a LiDAR of the slot may be mounted there, in that zone."""
    turn = (mount.roll, mount.pitch, mount.yaw)
    return distance(zone, mount.x, mount.y, mount.z) <= TOLERANCE and all(
        abs(math.remainder(angle - math.radians(low + high) / 2, math.tau))
        <= math.radians(high - low) / 2 + _OFF
        for angle, (low, high) in zip(turn, slot.spans.values(), strict=True)
    )


def _same(one: Mount, other: Mount) -> bool:
    return all(abs(a - b) < _OFF for a, b in zip(astuple(one), astuple(other), strict=True))


def zones_of(space: Space) -> list[search_json.Zone]:
    """Describe the zones of a search with their ranges of angles."""
    spans = {zone.name: space.spans(zone.name).items() for zone in space.zones}
    angles = {
        name: {f"{angle}_deg": span for angle, span in of_zone} for name, of_zone in spans.items()
    }
    return [
        search_json.Zone(name=zone.name, polygon=zone.polygon, z=zone.z, **angles[zone.name])
        for zone in space.zones
    ]
