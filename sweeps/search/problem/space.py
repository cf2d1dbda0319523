"""The space of rigs as parameters of Optuna, and back.

Positions are shares of a zone, from 0 to 1 along each of its axes: so every combination of values
is a position in the zone, whatever its shape, and the parameters are the same for all zones.
Angles are in degrees. What cannot vary is no parameter.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

from lidarplace.configuration.mounting import Pair, mountable
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.mounting.zone import Zone, left_half, on_centre_line, position, shares
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


@dataclass(frozen=True)
class Slot:
    """A LiDAR to place, or a mirrored pair of them.

    Attributes:
        name: prefix of its parameters, such as `lidar_1`.
        zones: where it may sit; of a pair the left one's.
        models: names of the LiDAR models that it may be.
        spans: roll, pitch, yaw of each of them, (min, max) in degrees, ego frame.
        pair: whether a mirrored one goes with it.
    """

    name: str
    zones: tuple[Zone, ...]
    models: tuple[str, ...]
    spans: Mapping[str, Pair]
    pair: bool

    @property
    def size(self) -> int:
        """LiDARs in it."""
        return 2 if self.pair else 1


class Space:
    """All rigs that a configuration allows.

    Args:
        models: names of the LiDAR models to choose from.
        fixed: LiDARs that every rig has.

    Raises:
        ValueError: symmetry is asked for, and no zone has room for it; or there are too many ways
            to divide LiDARs among zones.
    """

    def __init__(
        self, settings: SearchSettings, models: tuple[str, ...], fixed: Sequence[Choice]
    ) -> None:
        self.settings, self.models, self.fixed = settings, models, tuple(fixed)
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
            raise ValueError(
                f"search.zones: {ways:,} ways to divide LiDARs among them, more than "
                f"{MOST_MAKEUPS:,}; give ranges of `lidars` to fewer zones"
            )
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
            counted = zip(self.zones, makeup, strict=True)
            return [slot for zone, count in counted for slot in self._in_zone(zone, count)]
        (number,) = makeup
        spans = {name: getattr(self.settings, f"{name}_deg") for name in _ANGLES}
        if not self.settings.symmetric:
            return [
                Slot(f"lidar_{i + 1}", self.zones, self.models, spans, False) for i in range(number)
            ]
        pairs = [
            Slot(f"pair_{i + 1}", self._halves, self.models, spans, True)
            for i in range(number // 2)
        ]
        if number % 2 == 0:
            return pairs
        if not self._middles:
            raise ValueError("search.symmetric: an odd number needs a zone that meets y = 0")
        upright = spans | {"roll": (0.0, 0.0), "yaw": (0.0, 0.0)}
        return [*pairs, Slot("centre", self._middles, self.models, upright, False)]

    def _in_zone(self, zone: Zone, count: int) -> list[Slot]:
        """The slots of a zone that says how many LiDARs it has."""
        said, spans = self.settings.zones[zone.name], self.spans(zone.name)
        models = said.models or self.models
        return [
            Slot(f"{zone.name}_{i + 1}", (zone,), models, spans, said.mirrored)
            for i in range(count)
        ]

    def spans(self, zone: str) -> dict[str, Pair]:
        """Lowest and highest roll, pitch and yaw of a mount in that zone, degrees, ego frame."""
        said = self.settings.zones[zone]
        found = {
            a: getattr(said, f"{a}_deg") or getattr(self.settings, f"{a}_deg") for a in _ANGLES
        }
        low, high = found["yaw"]
        return found | {"yaw": (said.facing_deg + low, said.facing_deg + high)}

    @cached_property
    def _halves(self) -> tuple[Zone, ...]:
        return tuple(half for half in map(left_half, self.zones) if half is not None)

    @cached_property
    def _middles(self) -> tuple[Zone, ...]:
        return tuple(middle for middle in map(on_centre_line, self.zones) if middle is not None)

    def distributions(self, makeup: Makeup) -> dict[str, BaseDistribution]:
        """The parameters of a rig with so many LiDARs."""
        found: dict[str, BaseDistribution] = {}
        for slot in self.slots(makeup):
            found |= self.of_slot(slot)
        return found

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
            zone = next(zone for zone in slot.zones if zone.name == name)
            place = position(zone, *(params.get(f"{slot.name}.{axis}", 0.5) for axis in "xyz"))
            roll, pitch, yaw = (
                math.radians(params.get(f"{slot.name}.{angle}_deg", slot.spans[angle][0]))
                for angle in _ANGLES
            )
            mount = rounded(*place, roll, pitch, math.remainder(yaw, math.tau))
            lidars.append(Choice(model, name, mount))
            if slot.pair:
                lidars.append(Choice(model, name, mirrored(mount)))
        return ordered(lidars)

    def params(self, placed: Sequence[tuple[Slot, Choice]]) -> dict[str, Any]:
        """The parameters that give these LiDARs to all slots of a makeup; the inverse of `rig`."""
        found: dict[str, Any] = {}
        for name, (low, high) in self.counts.items():
            if self.settings.counted:
                number = sum(name == f"{slot.zones[0].name}.{NUMBER}" for slot, _ in placed)
            else:
                number = sum(slot.size for slot, _ in placed)
            if low < high:
                found[name] = number
        for slot, lidar in placed:
            zone = next(zone for zone in slot.zones if zone.name == lidar.zone)
            mount = lidar.mount
            values: dict[str, Any] = {"model": lidar.model, "zone": lidar.zone}
            place = shares(zone, mount.x, mount.y, mount.z)
            values |= dict(zip("xyz", place, strict=True))
            for angle, span in slot.spans.items():
                degrees = _near(math.degrees(getattr(mount, angle)), sum(span) / 2)
                values[f"{angle}_deg"] = degrees
            found |= self.allowed(slot, values)
        return found


def within(value: float, span: BaseDistribution) -> float:
    """The value, or the end of the span that is nearest to it."""
    assert isinstance(span, FloatDistribution)
    return min(max(value, span.low), span.high)


def _near(degrees: float, middle: float) -> float:
    """The same direction, less than half a turn from the middle of its span."""
    return degrees - 360 * round((degrees - middle) / 360)


def _check_symmetry(zones: Sequence[Zone]) -> None:
    """What lies right of the centre line has to be a mirror image of what lies left of it."""
    shapes = {(frozenset(zone.polygon), zone.z) for zone in zones}
    for zone in zones:
        mirrored_shape = frozenset((x, 0 - y) for x, y in zone.polygon)
        if any(y < 0 for _, y in zone.polygon) and (mirrored_shape, zone.z) not in shapes:
            raise ValueError(
                f"search.symmetric: zone {zone.name} is not symmetric to y = 0, and no other zone "
                "is its mirror image; give its left part alone"
            )


def _extent(zone: Zone) -> tuple[float, float, float]:
    ys = [y for _, y in zone.polygon]
    return zone.x[1] - zone.x[0], max(ys) - min(ys), zone.z[1] - zone.z[0]
