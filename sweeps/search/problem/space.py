"""The space of rigs as parameters of Optuna, and back; rigs assigned to its slots.

Positions are shares of a zone, from 0 to 1 along each of its axes: so every combination of values
is a position in the zone, whatever its shape, and the parameters are the same for all zones.
Angles are in degrees; where models have different ranges, an angle is a share of its range. Numbers
of LiDARs and models that break a bound stand for the nearest that keep all: so every combination of
values is a rig that keeps them. Values that cannot vary have no parameter."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, replace
from functools import cached_property
from operator import sub
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

from lidarplace import Mount
from lidarplace.base.errors import InputError
from lidarplace.base.number_text import point
from lidarplace.configuration.mounting import mountable
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.configuration.zones import AngleSettings
from lidarplace.mounting.counts import CountBound, most_in_zone
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
from sweeps.search.problem.counts import CountsPerZone, count_all, nearest_models, possible_counts
from sweeps.search.problem.rig import MountedLidar, Rig, mirrored, ordered, rounded
from sweeps.search.problem.slots import ANGLES, Assignment, MountSlot, Spans

NUMBER = "lidars"
"""Parameter for the number of LiDARs: of all zones together, or after the name of a zone."""
_OFF = 1e-4
"""Radians by which an angle may be outside of its range."""


class Space:
    """Rigs that a configuration allows, of LiDAR `models` by name and those that are `fixed`.

    Attributes:
        groups: slots by their number, by zone, or by "" for all zones together.
        all_counts: numbers of LiDARs in the groups, fewest LiDARs first.
        bounds: of zones and models that have any, of all LiDARs.
        sum_bounds: of all LiDARs, then of models.

    Raises ValueError: no zone is wide enough for symmetry, or no rig keeps all bounds, or there are
    too many ways to divide LiDARs among zones."""

    def __init__(
        self, settings: SearchSettings, models: tuple[str, ...], fixed: Sequence[MountedLidar]
    ) -> None:
        self.settings, self.models, self.fixed = settings, models, ordered(fixed)
        self.zones = mountable(settings.zones, vehicle_of(settings.vehicle))
        if settings.symmetric:
            _check_symmetry(self.zones)
        counts = settings.zone_counts if settings.by_zone else {"": settings.total}
        total, zone_bounds, model_bounds = self._count_bounds()
        self.sum_bounds = (total, *model_bounds)
        groups = [
            {n: self._group_slots(zone, n) for n in range(low, high + 1)}
            for zone, (low, high) in counts.items()
        ]
        self.all_counts = count_all(groups, self.sum_bounds)
        self.groups = dict(zip(counts, groups, strict=True))
        total = replace(total, low=self.numbers[0], high=self.numbers[1])
        self.bounds = (*zone_bounds, *model_bounds, total)
        self._completed: dict[object, bool] = {}

    def _count_bounds(self) -> tuple[CountBound, list[CountBound], list[CountBound]]:
        """Return the bounds of all LiDARs, of zones and of models.

        Raises InputError: a zone is too small for its least number."""
        zones, distance = self.settings.zones, self.settings.constraints.distance
        models = {name: model.count for name, model in self.settings.models.items() if model.count}
        total = CountBound("lidars", *self.settings.total)
        of_zones = [
            CountBound(f"zones.{name}.lidars", *zone.lidars, zone=name, size=zone.size)
            for name, zone in zones.items()
            if zone.lidars
        ]
        of_models = [CountBound(f"models.{m}.count", *n, model=m) for m, n in models.items()]
        room = {zone.name: most_in_zone(zone, distance) for zone in self.zones}
        size = 2 if self.settings.symmetric else 1
        most = sum(number * max(size, zones[zone].size) for zone, number in room.items())
        for bound in (*of_zones, total):
            if bound.low > (number := room.get(bound.zone or "", most)):
                problem = f"too many for zones of this size, {distance:g} m from each other"
                key, expected = f"search.{bound.key}", f"at most {number:g}"
                fix = "enlarge a zone, or reduce constraints.distance"
                raise InputError(problem, key=key, expected=expected, found=bound.text, fix=fix)
        return total, of_zones, of_models

    @cached_property
    def count_ranges(self) -> dict[str, tuple[int, int]]:
        """Least and greatest number of LiDARs, by the parameter's name."""
        names = (f"{zone}.{NUMBER}" if zone else NUMBER for zone in self.groups)
        columns = zip(*self.all_counts, strict=True)
        return {name: (min(c), max(c)) for name, c in zip(names, columns, strict=True)}

    @cached_property
    def sizes(self) -> dict[CountsPerZone, tuple[int, ...]]:
        """LiDARs of each of `groups` by counts per zone, without the fixed ones."""
        return {
            counts: tuple(
                sum(slot.size for slot in group[number])
                for group, number in zip(self.groups.values(), counts, strict=True)
            )
            for counts in self.all_counts
        }

    @cached_property
    def numbers(self) -> tuple[int, int]:
        """The least and the greatest number of LiDARs, without the fixed ones."""
        numbers = [sum(sizes) for sizes in self.sizes.values()]
        return numbers[0], numbers[-1]

    def completes(self, parts: Sequence[Rig]) -> bool:
        """Return whether parts, a LiDAR or a mirrored pair each, fit into a rig of these counts."""
        zones = ("" if "" in self.groups else part[0].zone for part in parts)
        used = Counter(zip(zones, map(len, parts), strict=True))
        lidars = [lidar for part in parts for lidar in part]
        bounds = [bound.less(bound.number(lidars)) for bound in self.sum_bounds]
        key = frozenset(used.items()), tuple(bounds)
        if key not in self._completed:
            groups = []
            for zone, group in self.groups.items():
                sizes = {size: used[zone, size] for size in (1, 2)}
                rests = ((number, _without(slots, sizes)) for number, slots in group.items())
                groups.append({number: rest for number, rest in rests if rest is not None})
            self._completed[key] = bool(possible_counts(groups, bounds))
        return self._completed[key]

    @property
    def numbers_of_parameters(self) -> tuple[int, int]:
        """The least and the greatest number of parameters of a rig."""
        sizes = [len(self.distributions(counts)) for counts in self.all_counts]
        return min(sizes), max(sizes)

    def slots(self, counts: CountsPerZone) -> list[MountSlot]:
        """Return the slots to fill for these counts."""
        groups = zip(self.groups.values(), counts, strict=True)
        return [slot for group, number in groups for slot in group[number]]

    def _group_slots(self, zone: str, number: int) -> list[MountSlot]:
        """Return so many slots of a zone, or, for "", the slots of so many LiDARs in all zones."""
        models, zones = self.zone_models(zone), self.zones
        spans = {model: self.spans(zone, model) for model in models}
        if zone:
            kind = (tuple(z for z in zones if z.name == zone), models, spans)
            pair = self.settings.zones[zone].mirrored
            return [MountSlot(f"{zone}_{i + 1}", *kind, pair) for i in range(number)]
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
        level = {"roll": (0.0, 0.0), "yaw": (0.0, 0.0)}
        upright = {model: {**angles, **level} for model, angles in spans.items()}
        return [*pairs, MountSlot("centre", middles, models, upright, False)]

    def zone_models(self, zone: str) -> tuple[str, ...]:
        """Return the models that a zone allows; all for ""."""
        settings = self.settings.zones.get(zone)
        return self.models if settings is None or not settings.models else (*settings.models,)

    def spans(self, zone: str, model: str) -> Spans:
        """Return lowest and highest roll, pitch and yaw of a model in a zone; "" for all zones."""
        of_zone = self.settings.zones.get(zone)
        sources: list[AngleSettings | SearchSettings] = [self.settings]
        if of_zone is not None:
            sources = [*filter(None, [(of_zone.models or {}).get(model)]), of_zone, self.settings]
        keys = [f"{angle}_deg" for angle in ANGLES]
        roll, pitch, yaw = (
            next(span for source in sources if (span := getattr(source, key)) is not None)
            for key in keys
        )
        facing = 0.0 if of_zone is None else of_zone.facing_deg
        low, high = (facing + end for end in yaw)
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
        for name in ANGLES:
            span = slot.common_span(name)
            if span is None:
                distributions[name] = FloatDistribution(0.0, 1.0)
            elif span[0] < span[1]:
                distributions[f"{name}_deg"] = FloatDistribution(*span)
        return {f"{slot.name}.{name}": distribution for name, distribution in distributions.items()}

    def allowed(self, slot: MountSlot, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters of a slot, within their spans; `values` lack its prefix.

        Angles are in degrees, for the model of `values`."""
        values = dict(values)
        for angle, (low, high) in slot.spans[values["model"]].items():
            share = (values[f"{angle}_deg"] - low) / ((high - low) or 1.0)
            values[angle] = share if low < high else 0.5
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
        """Return how many LiDARs these parameters ask for, or the nearest counts of a rig."""
        wanted = tuple(int(params.get(name, low)) for name, (low, _) in self.count_ranges.items())
        if wanted in self.sizes:
            return wanted
        return min(self.all_counts, key=lambda c: sum(map(abs, map(sub, c, wanted))))

    def rig(self, params: Mapping[str, Any]) -> Rig:
        """Return the rig of these parameters."""
        lidars, slots = list(self.fixed), self.slots(self.counts_per_zone(params))
        wanted = [params.get(f"{slot.name}.model", slot.models[0]) for slot in slots]
        models = nearest_models(slots, wanted, self.sum_bounds[1:])
        assert models is not None, "counts_per_zone has counts that a choice of models keeps"
        for slot, model in zip(slots, models, strict=True):
            name = params.get(f"{slot.name}.zone", slot.zones[0].name)
            along = (params.get(f"{slot.name}.{axis}", 0.5) for axis in "xyz")
            place = position(slot.zone(name), *along)
            roll, pitch, yaw = (
                math.radians(_degrees(params, f"{slot.name}.{angle}", *span))
                for angle, span in slot.spans[model].items()
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
                    if self.settings.by_zone
                    else sum(slot.size for slot in slots)
                )
        for place in placed:
            slot, lidar, mount = place.slot, place.lidar, place.lidar.mount
            along = shares(slot.zone(lidar.zone), mount.x, mount.y, mount.z)
            values: dict[str, Any] = {"model": lidar.model, "zone": lidar.zone}
            values |= zip("xyz", along, strict=True)
            for angle, span in slot.spans[lidar.model].items():
                degrees, centre = math.degrees(getattr(mount, angle)), sum(span) / 2
                # The same direction, less than half a turn from the middle of its span.
                values[f"{angle}_deg"] = degrees - 360 * round((degrees - centre) / 360)
            parameters |= self.allowed(slot, values)
        return parameters


def _degrees(params: Mapping[str, Any], name: str, low: float, high: float) -> float:
    """Return an angle: a parameter in degrees, or a share of the span from `low` to `high`."""
    share = params.get(name, 0.0)
    return float(params.get(f"{name}_deg", low + share * (high - low)))


def within(value: float, span: FloatDistribution) -> float:
    """Return the value, or the nearest end of the span."""
    return min(max(value, span.low), span.high)


def _without(slots: Sequence[MountSlot], used: Mapping[int, int]) -> list[MountSlot] | None:
    """Return the slots less so many of each size; None if there are not as many."""
    by_size = {size: [slot for slot in slots if slot.size == size] for size in (1, 2)}
    if any(len(alike) < used[size] for size, alike in by_size.items()):
        return None
    return [slot for size, alike in by_size.items() for slot in alike[used[size] :]]


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


def broken_count(space: Space, lidars: Iterable[MountedLidar]) -> tuple[CountBound, int] | None:
    """Return the first bound that LiDARs break, without the fixed ones, and their number there."""
    placed = [lidar for lidar in lidars if lidar not in space.fixed]
    numbers = ((bound, bound.number(placed)) for bound in space.bounds)
    return next(((bound, n) for bound, n in numbers if not bound.allows(n)), None)


def assign_to_slots(space: Space, lidars: Sequence[MountedLidar]) -> list[Assignment]:
    """Assign each of the LiDARs, without the fixed ones, to a slot of its kind.

    LiDARs without a zone get the first one that holds them, and those without a model the first
    that has these angles there, or another where bounds need it. Raises ValueError: the space has
    no rigs of such counts, or a LiDAR has no slot."""
    total, left = space.bounds[-1], list(lidars)
    if not total.allows(len(lidars)):
        problem = "more or fewer LiDARs than search.lidars allows"
        raise InputError(problem, expected=total.text, found=len(lidars))
    named = Counter(lidar.zone for lidar in lidars)
    broken = None
    for counts_per_zone, sizes in space.sizes.items():
        by_zone = zip(space.groups, sizes, strict=True)
        if sum(sizes) != len(lidars) or any(zone and named[zone] > n for zone, n in by_zone):
            continue
        assignments, left = _in_slots(space.slots(counts_per_zone), lidars)
        if not left:
            assignments, broken = _with_models(space, assignments)
            if broken is None:
                return assignments
    if broken is not None:
        bound, number = broken
        raise InputError(key=f"search.{bound.key}", expected=bound.text, found=number)
    mount = left[0].mount
    place = point(mount.x, mount.y, mount.z)
    raise InputError(f"no zone or mirrored pair allows a LiDAR at {place} with its angles")


def _with_models(
    space: Space, assignments: Sequence[Assignment]
) -> tuple[list[Assignment], tuple[CountBound, int] | None]:
    """Choose models for LiDARs without one so that bounds are kept; return a bound that is not."""
    slots = [replace(place.slot, models=_fitting_models(place)) for place in assignments]
    first = [slot.models[0] for slot in slots]
    models = nearest_models(slots, first, space.sum_bounds[1:]) or first
    chosen = [
        replace(place, lidar=replace(place.lidar, model=model))
        for place, model in zip(assignments, models, strict=True)
    ]
    return chosen, broken_count(space, (lidar for place in chosen for lidar in place.rig))


def _fitting_models(place: Assignment) -> tuple[str, ...]:
    """Return the model of a LiDAR, or those that may be mounted there if it has none."""
    slot, lidar = place.slot, place.lidar
    zone, models = slot.zone(lidar.zone), (lidar.model,) if lidar.model else slot.models
    return tuple(model for model in models if fits(slot, zone, lidar.mount, model))


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
    mount, models = lidar.mount, (lidar.model,) if lidar.model else slot.models
    if slot.pair:
        other = mirrored(mount)
        if mount.y <= 0 or not any(_same(lidar.mount, other) for lidar in left):
            return None
    for zone in slot.zones:
        if lidar.zone in ("", zone.name) and any(fits(slot, zone, mount, m) for m in models):
            return Assignment(slot, MountedLidar(lidar.model, zone.name, mount))
    return None


def fits(slot: MountSlot, zone: Zone, mount: Mount, model: str) -> bool:
    """Return whether a LiDAR of the slot may be mounted there, in that zone, of that model."""
    turn = (mount.roll, mount.pitch, mount.yaw)
    return (
        model in slot.models
        and distance(zone, mount.x, mount.y, mount.z) <= TOLERANCE
        and all(
            abs(math.remainder(angle - math.radians(low + high) / 2, math.tau))
            <= math.radians(high - low) / 2 + _OFF
            for angle, (low, high) in zip(turn, slot.spans[model].values(), strict=True)
        )
    )


def _same(one: Mount, other: Mount) -> bool:
    return all(abs(a - b) < _OFF for a, b in zip(astuple(one), astuple(other), strict=True))
