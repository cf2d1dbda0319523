"""The space of rigs as parameters of Optuna, and back; rigs taken apart into its slots.

Positions are shares of a zone, from 0 to 1 along each of its axes: so every combination of values
is a position in the zone, whatever its shape, and the parameters are the same for all zones.
Angles are in degrees. What cannot vary is no parameter.
"""

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
from sweeps.search.problem.choice import Choice, Choices, mirrored, ordered, rounded

NUMBER = "lidars"
"""The parameter for the number of LiDARs: of all zones together, or after the name of a zone."""
MOST_MAKEUPS = 10_000
"""Ways to divide LiDARs among zones."""
Makeup = tuple[int, ...]
"""How many LiDARs there are to place: in all zones together, or in each zone that says how many; a
mirrored pair of a zone counts once."""
_ANGLES = ("roll", "pitch", "yaw")
_OFF = 1e-4
"""Radians by which an angle may be outside of its range."""


@dataclass(frozen=True)
class Slot:
    """A LiDAR to place, or the left one of a mirrored pair: `name` is the prefix of its parameters,
    such as `lidar_1`; spans of roll, pitch, yaw in degrees, ego frame."""

    name: str
    zones: tuple[Zone, ...]
    models: tuple[str, ...]
    spans: Mapping[str, Pair]
    pair: bool

    @property
    def size(self) -> int:
        """LiDARs in it."""
        return 2 if self.pair else 1

    def zone(self, name: str) -> Zone:
        """Its zone of that name."""
        return next(zone for zone in self.zones if zone.name == name)


@dataclass(frozen=True)
class Placed:
    """A LiDAR, or the left one of a mirrored pair, in a slot, which has a trial's parameters."""

    slot: Slot
    lidar: Choice

    @property
    def rig(self) -> Choices:
        """It, or the pair."""
        other = replace(self.lidar, mount=mirrored(self.lidar.mount))
        return ordered([self.lidar, other] if self.slot.pair else [self.lidar])


class Space:
    """All rigs that a configuration allows, of LiDAR `models` by name and those that are `fixed`.
    Raises ValueError: no zone has room for symmetry, or there are too many ways to divide LiDARs
    among zones."""

    def __init__(
        self, settings: SearchSettings, models: tuple[str, ...], fixed: Sequence[Choice]
    ) -> None:
        self.settings, self.models, self.fixed = settings, models, ordered(fixed)
        self.zones = mountable(settings.zones, vehicle_of(settings.vehicle))
        if settings.symmetric:
            _check_symmetry(self.zones)
        self.makeups = self._makeups()

    @cached_property
    def counts(self) -> dict[str, Pair]:
        """How many LiDARs there may be at least and at most, by the parameter's name."""
        if not self.settings.counted:
            return {NUMBER: self.settings.lidars}
        zones = self.settings.zones.items()
        return {f"{name}.{NUMBER}": zone.lidars for name, zone in zones if zone.lidars}

    def _makeups(self) -> tuple[Makeup, ...]:
        """All that there may be, without the fixed LiDARs; those with fewest LiDARs first."""
        ways = math.prod(int(high - low) + 1 for low, high in self.counts.values())
        if ways > MOST_MAKEUPS:
            most, fix = f"at most {MOST_MAKEUPS:,}", "set ranges of `lidars` in fewer zones"
            problem, key = "too many ways to divide LiDARs", "search.zones"
            raise InputError(problem, key=key, expected=most, found=f"{ways:,}", fix=fix)
        ranges = (range(int(low), int(high) + 1) for low, high in self.counts.values())
        found = itertools.product(*ranges)
        return tuple(sorted(found, key=lambda makeup: (self._size(makeup), makeup)))

    def _size(self, makeup: Makeup) -> int:
        return sum(slot.size for slot in self.slots(makeup))

    @cached_property
    def numbers(self) -> tuple[int, int]:
        """The least and the greatest number of LiDARs, without the fixed ones."""
        sizes = [self._size(makeup) for makeup in (self.makeups[0], self.makeups[-1])]
        return sizes[0], sizes[1]

    def slots(self, makeup: Makeup) -> list[Slot]:
        """What has to be placed to have so many LiDARs."""
        if self.settings.counted:
            found: list[Slot] = []
            for zone, count in zip(self.zones, makeup, strict=True):
                own = self.settings.zones[zone.name]
                kind = ((zone,), own.models or self.models, self.spans(zone.name), own.mirrored)
                found += [Slot(f"{zone.name}_{i + 1}", *kind) for i in range(count)]
            return found
        (number,) = makeup
        spans = {name: getattr(self.settings, f"{name}_deg") for name in _ANGLES}
        zones, models = self.zones, self.models
        if not self.settings.symmetric:
            return [Slot(f"lidar_{i + 1}", zones, models, spans, False) for i in range(number)]
        halves = tuple(filter(None, map(left_half, zones)))
        pairs = [Slot(f"pair_{i + 1}", halves, models, spans, True) for i in range(number // 2)]
        if number % 2 == 0:
            return pairs
        middles = tuple(filter(None, map(on_centre_line, zones)))
        if not middles:
            raise InputError("an odd number needs a zone that meets y = 0", key="search.symmetric")
        upright = spans | {"roll": (0.0, 0.0), "yaw": (0.0, 0.0)}
        return [*pairs, Slot("centre", middles, models, upright, False)]

    def spans(self, zone: str) -> dict[str, Pair]:
        """Lowest and highest roll, pitch and yaw of a mount in that zone, degrees, ego frame."""
        own, keys = self.settings.zones[zone], {angle: f"{angle}_deg" for angle in _ANGLES}
        found = {a: getattr(own, key) or getattr(self.settings, key) for a, key in keys.items()}
        low, high = found["yaw"]
        return found | {"yaw": (own.facing_deg + low, own.facing_deg + high)}

    def distributions(self, makeup: Makeup) -> dict[str, BaseDistribution]:
        """The parameters of a rig with so many LiDARs."""
        own = (self.of_slot(slot) for slot in self.slots(makeup))
        return {name: distribution for slot in own for name, distribution in slot.items()}

    def of_slot(self, slot: Slot) -> dict[str, BaseDistribution]:
        """The parameters of a LiDAR, or of the left one of a pair."""
        found: dict[str, BaseDistribution] = {}
        if len(slot.models) > 1:
            found["model"] = CategoricalDistribution(slot.models)
        if len(slot.zones) > 1:
            found["zone"] = CategoricalDistribution([zone.name for zone in slot.zones])
        for axis, name in enumerate("xyz"):
            if any(_extent(zone)[axis] > 0 for zone in slot.zones):
                found[name] = FloatDistribution(0.0, 1.0)
        for name, (low, high) in slot.spans.items():
            if low < high:
                found[f"{name}_deg"] = FloatDistribution(low, high)
        return {f"{slot.name}.{name}": distribution for name, distribution in found.items()}

    def allowed(self, slot: Slot, values: Mapping[str, Any]) -> dict[str, Any]:
        """The parameters of a slot, from values by name without its prefix, within their spans."""
        found = {}
        for name, span in self.of_slot(slot).items():
            value = values[name.removeprefix(f"{slot.name}.")]
            found[name] = within(value, span) if isinstance(span, FloatDistribution) else value
        return found

    def suggest(self, trial: optuna.Trial) -> Choices:
        """Ask a trial for all its parameters, which depend on the number of LiDARs."""
        for name, (low, high) in self.counts.items():
            if low < high:
                trial.suggest_int(name, int(low), int(high))
        for name, own in self.distributions(self.makeup(trial.params)).items():
            if isinstance(own, FloatDistribution):
                trial.suggest_float(name, own.low, own.high)
            else:
                assert isinstance(own, CategoricalDistribution)
                trial.suggest_categorical(name, own.choices)
        return self.rig(trial.params)

    def makeup(self, params: Mapping[str, Any]) -> Makeup:
        """How many LiDARs these parameters ask for."""
        return tuple(int(params.get(name, low)) for name, (low, _) in self.counts.items())

    def rig(self, params: Mapping[str, Any]) -> Choices:
        """The rig of these parameters."""
        lidars = list(self.fixed)
        for slot in self.slots(self.makeup(params)):
            model = params.get(f"{slot.name}.model", slot.models[0])
            name = params.get(f"{slot.name}.zone", slot.zones[0].name)
            along = (params.get(f"{slot.name}.{axis}", 0.5) for axis in "xyz")
            place = position(slot.zone(name), *along)
            roll, pitch, yaw = (
                math.radians(params.get(f"{slot.name}.{angle}_deg", slot.spans[angle][0]))
                for angle in _ANGLES
            )
            mount = rounded(*place, roll, pitch, math.remainder(yaw, math.tau))
            lidars += Placed(slot, Choice(model, name, mount)).rig
        return ordered(lidars)

    def params(self, placed: Sequence[Placed]) -> dict[str, Any]:
        """The parameters that give these LiDARs to all slots of a makeup; the inverse of `rig`."""
        found: dict[str, Any] = {}
        for name, (low, high) in self.counts.items():
            if low < high:
                own = [place.slot for place in placed]
                found[name] = (
                    sum(name == f"{slot.zones[0].name}.{NUMBER}" for slot in own)
                    if self.settings.counted
                    else sum(slot.size for slot in own)
                )
        for place in placed:
            slot, lidar, mount = place.slot, place.lidar, place.lidar.mount
            along = shares(slot.zone(lidar.zone), mount.x, mount.y, mount.z)
            values: dict[str, Any] = {"model": lidar.model, "zone": lidar.zone}
            values |= zip("xyz", along, strict=True)
            for angle, span in slot.spans.items():
                degrees, middle = math.degrees(getattr(mount, angle)), sum(span) / 2
                # The same direction, less than half a turn from the middle of its span.
                values[f"{angle}_deg"] = degrees - 360 * round((degrees - middle) / 360)
            found |= self.allowed(slot, values)
        return found


def within(value: float, span: FloatDistribution) -> float:
    """The value, or the end of the span that is nearest to it."""
    return min(max(value, span.low), span.high)


def _check_symmetry(zones: Sequence[Zone]) -> None:
    """What lies right of the centre line has to be a mirror image of what lies left of it."""
    shapes = {(frozenset(zone.polygon), zone.z) for zone in zones}
    for zone in zones:
        mirrored_shape = frozenset((x, 0 - y) for x, y in zone.polygon)
        if any(y < 0 for _, y in zone.polygon) and (mirrored_shape, zone.z) not in shapes:
            problem = f"zone {zone.name} is not symmetric to y = 0, nor to another zone"
            raise InputError(problem, key="search.symmetric", fix="define its left part alone")


def _extent(zone: Zone) -> tuple[float, float, float]:
    ys = [y for _, y in zone.polygon]
    return zone.x[1] - zone.x[0], max(ys) - min(ys), zone.z[1] - zone.z[0]


def placed_in(space: Space, lidars: Sequence[Choice]) -> list[Placed]:
    """Give each of the LiDARs, without the fixed ones, to a slot of its kind. LiDARs without a zone
    get the first one that holds them, and those without a model its first. Raises ValueError: their
    number is none of the space's, or one has no slot."""
    least, most = space.numbers
    if not least <= len(lidars) <= most:
        raise InputError(f"has {len(lidars)} LiDARs, more or fewer than search.lidars")
    left: list[Choice] = list(lidars)
    for makeup in space.makeups:
        slots = space.slots(makeup)
        if sum(slot.size for slot in slots) != len(lidars):
            continue
        found, left = _in_slots(slots, lidars)
        if not left:
            return found
    mount = left[0].mount
    place = point(mount.x, mount.y, mount.z)
    raise InputError(f"no zone or mirrored pair allows a LiDAR at {place} with its angles")


def _in_slots(slots: Sequence[Slot], lidars: Sequence[Choice]) -> tuple[list[Placed], list[Choice]]:
    """Each of the LiDARs in a slot, and those that are left when one slot gets none."""
    left, found = list(lidars), []
    for slot in slots:
        place = next((p for lidar in left if (p := _in_slot(slot, lidar, left))), None)
        if place is None:
            break
        found.append(place)
        for mount in (own.mount for own in place.rig):
            left.remove(next(lidar for lidar in left if _same(lidar.mount, mount)))
    return found, left


def rig_of(placed: Sequence[Placed], space: Space) -> Choices:
    """The rig of these LiDARs and those that every rig has."""
    return ordered([*space.fixed, *(lidar for place in placed for lidar in place.rig)])


def _in_slot(slot: Slot, lidar: Choice, left: Sequence[Choice]) -> Placed | None:
    """The LiDAR in that slot; a pair needs its mirrored one among those `left`."""
    mount, model = lidar.mount, lidar.model or slot.models[0]
    if model not in slot.models:
        return None
    if slot.pair:
        other = mirrored(mount)
        if mount.y <= 0 or not any(_same(own.mount, other) for own in left):
            return None
    for zone in slot.zones:
        if lidar.zone in ("", zone.name) and fits(slot, zone, mount):
            return Placed(slot, Choice(model, zone.name, mount))
    return None


def fits(slot: Slot, zone: Zone, mount: Mount) -> bool:
    """Whether a LiDAR of the slot might sit there, in that zone."""
    turn = (mount.roll, mount.pitch, mount.yaw)
    return distance(zone, mount.x, mount.y, mount.z) <= TOLERANCE and all(
        abs(math.remainder(angle - math.radians(low + high) / 2, math.tau))
        <= math.radians(high - low) / 2 + _OFF
        for angle, (low, high) in zip(turn, slot.spans.values(), strict=True)
    )


def _same(one: Mount, other: Mount) -> bool:
    return all(abs(a - b) < _OFF for a, b in zip(astuple(one), astuple(other), strict=True))
