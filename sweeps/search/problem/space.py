"""The space of rigs as parameters of Optuna, and back.

Positions are shares of a zone, from 0 to 1 along each of its axes: so every combination of values
is a position in the zone, whatever its shape, and the parameters are the same for all zones.
Angles are in degrees. What cannot vary is no parameter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)

from lidarplace import Mount
from lidarplace.mounting.zone import Zone, left_half, on_centre_line, position, shares
from sweeps.configuration.search import Pair, RangeSettings, SearchSettings
from sweeps.search.problem.choice import Choice, Choices, mirrored, ordered, rounded

NUMBER = "lidars"
"""The parameter for the number of LiDARs."""

_ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Slot:
    """A LiDAR to place, or a mirrored pair of them.

    Attributes:
        name: prefix of its parameters, such as `lidar_1`.
        zones: where it may sit; of a pair the left one's.
        spans: roll, pitch, yaw of each of them, (min, max) in degrees.
        pair: whether a mirrored one goes with it.
    """

    name: str
    zones: tuple[Zone, ...]
    spans: Mapping[str, Pair]
    pair: bool


class Space:
    """All rigs that a configuration allows.

    Args:
        models: names of the LiDAR models to choose from.
        fixed: LiDARs that every rig has.

    Raises:
        ValueError: symmetry is asked for, and no zone has room for it.
    """

    def __init__(
        self, settings: SearchSettings, models: tuple[str, ...], fixed: Sequence[Choice]
    ) -> None:
        self.settings, self.models, self.fixed = settings, models, tuple(fixed)
        self.zones = tuple(zone.zone(name) for name, zone in settings.zones.items())
        if settings.symmetric:
            _check_symmetry(self.zones)
        for number in self.numbers:
            self.slots(number)

    @property
    def numbers(self) -> range:
        """How many LiDARs there may be, without the fixed ones."""
        if not self.zones:
            return range(1)
        low, high = self.settings.lidars
        return range(low, high + 1)

    def slots(self, number: int) -> list[Slot]:
        """What has to be placed to have that many LiDARs."""
        spans = {name: getattr(self.settings, f"{name}_deg") for name in _ANGLES}
        if not self.settings.symmetric:
            return [Slot(f"lidar_{i + 1}", self.zones, spans, False) for i in range(number)]
        pairs = [
            Slot(f"pair_{i + 1}", self._halves, spans, True) for i in range(number // 2)
        ]  # fmt: skip
        if number % 2 == 0:
            return pairs
        if not self._middles:
            raise ValueError("search.symmetric: an odd number needs a zone that meets y = 0")
        upright = spans | {"roll": (0.0, 0.0), "yaw": (0.0, 0.0)}
        return [*pairs, Slot("centre", self._middles, upright, False)]

    @cached_property
    def _halves(self) -> tuple[Zone, ...]:
        return tuple(half for half in map(left_half, self.zones) if half is not None)

    @cached_property
    def _middles(self) -> tuple[Zone, ...]:
        return tuple(middle for middle in map(on_centre_line, self.zones) if middle is not None)

    def distributions(self, number: int) -> dict[str, BaseDistribution]:
        """The parameters of a rig with that many LiDARs."""
        found: dict[str, BaseDistribution] = {}
        for slot in self.slots(number):
            found |= self._of_slot(slot)
        return found

    def _of_slot(self, slot: Slot) -> dict[str, BaseDistribution]:
        found: dict[str, BaseDistribution] = {}
        if len(self.models) > 1:
            found["model"] = CategoricalDistribution(self.models)
        if len(slot.zones) > 1:
            found["zone"] = CategoricalDistribution([zone.name for zone in slot.zones])
        for axis, name in enumerate("xyz"):
            if any(_extent(zone)[axis] > 0 for zone in slot.zones):
                found[name] = FloatDistribution(0.0, 1.0)
        for name, (low, high) in slot.spans.items():
            if low < high:
                found[f"{name}_deg"] = FloatDistribution(low, high)
        return {f"{slot.name}.{name}": distribution for name, distribution in found.items()}

    @cached_property
    def further(self) -> dict[str, BaseDistribution]:
        """The parameters that are key paths of the configuration."""
        return {key: _distribution(values) for key, values in self.settings.space.items()}

    def suggest(self, trial: optuna.Trial) -> tuple[Choices, dict[str, Any]]:
        """Ask a trial for all its parameters. Returns the rig, and values by key path.

        The parameters of a rig depend on the number of its LiDARs.
        """
        numbers = self.numbers
        number = numbers[0]
        if len(numbers) > 1:
            number = trial.suggest_int(NUMBER, numbers[0], numbers[-1])
        for name, distribution in (self.distributions(number) | self.further).items():
            _suggest(trial, name, distribution)
        values = {key: trial.params[key] for key in self.further}
        return self.rig(number, trial.params), values

    def rig(self, number: int, params: Mapping[str, Any]) -> Choices:
        """The rig of these parameters."""
        lidars = list(self.fixed)
        for slot in self.slots(number):
            model = params.get(f"{slot.name}.model", self.models[0])
            name = params.get(f"{slot.name}.zone", slot.zones[0].name)
            zone = next(zone for zone in slot.zones if zone.name == name)
            place = position(zone, *(params.get(f"{slot.name}.{axis}", 0.5) for axis in "xyz"))
            turn = (
                math.radians(params.get(f"{slot.name}.{angle}_deg", slot.spans[angle][0]))
                for angle in _ANGLES
            )
            mount = rounded(Mount(*place, *turn))
            lidars.append(Choice(model, name, mount))
            if slot.pair:
                lidars.append(Choice(model, name, mirrored(mount)))
        return ordered(lidars)

    def params(self, placed: Sequence[tuple[Slot, Choice]]) -> dict[str, Any]:
        """The parameters that give these LiDARs to their slots; the inverse of `rig`."""
        found: dict[str, Any] = {}
        for slot, lidar in placed:
            zone = next(zone for zone in slot.zones if zone.name == lidar.zone)
            mount = lidar.mount
            values: dict[str, Any] = {"model": lidar.model, "zone": lidar.zone}
            place = shares(zone, mount.x, mount.y, mount.z)
            values |= dict(zip("xyz", place, strict=True))
            for angle, (low, high) in slot.spans.items():
                degrees = math.degrees(getattr(mount, angle))
                values[f"{angle}_deg"] = min(max(degrees, low), high)
            known = self._of_slot(slot)
            named = {f"{slot.name}.{name}": value for name, value in values.items()}
            found |= {name: value for name, value in named.items() if name in known}
        number = sum(2 if slot.pair else 1 for slot, _ in placed)
        return found | ({NUMBER: number} if len(self.numbers) > 1 else {})


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


def _distribution(values: list[Any] | RangeSettings) -> BaseDistribution:
    if not isinstance(values, RangeSettings):
        return CategoricalDistribution(values)
    if isinstance(values.low, int) and isinstance(values.high, int):
        return IntDistribution(values.low, values.high, log=values.log)
    return FloatDistribution(float(values.low), float(values.high), log=values.log)


def _suggest(trial: optuna.Trial, name: str, distribution: BaseDistribution) -> Any:
    if isinstance(distribution, FloatDistribution):
        return trial.suggest_float(name, distribution.low, distribution.high, log=distribution.log)
    if isinstance(distribution, IntDistribution):
        return trial.suggest_int(name, distribution.low, distribution.high, log=distribution.log)
    assert isinstance(distribution, CategoricalDistribution)
    return trial.suggest_categorical(name, distribution.choices)
