"""Constraints of a rig: spacing, body in view, price, power and requirements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from lidarplace import Lidar, Placement, Roi
from lidarplace.clouds.blind_lidars import blind_lidars
from lidarplace.configuration.mounting import carrier_of, keep_out_boxes, mountable
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.mounting.limits import Limits, MountedSensors, excess, worst
from lidarplace.mounting.vehicle import Vehicle, zone_in_body
from lidarplace.requirements.check_requirements import RequirementResult, check_requirements
from lidarplace.requirements.layout import RequirementLayout
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.scenes.kinds import poles_at
from sweeps.configuration.objective import TOTALS
from sweeps.configuration.search import SearchFile, SearchSettings
from sweeps.search.problem.rig import Rig, is_possible, placement_of

TIE = 1e-3
"""Share of a violation by which rigs differ for the sampler if their worst cases are equal."""


@dataclass(frozen=True)
class Constraint:
    """A lower or an upper bound on a measure of a rig, such as `distance`."""

    name: str
    unit: str
    limit: float
    at_least: bool

    @property
    def sense(self) -> Literal["at least", "at most"]:
        """The direction of the bound in words."""
        return "at least" if self.at_least else "at most"

    def violation(self, measure: float) -> float:
        """Return by how much a measure violates the bound, in its unit; 0 or less if it is kept."""
        return excess(measure, self.limit, at_least=self.at_least)

    def sampler_violation(self, violation: float, enough: float) -> float:
        """Return a violation for the sampler, a share of the limit; 0 or less if the bound is kept.

        Of two equal violations that is larger where fewer positions have enough."""
        return violation / (abs(self.limit) or 1.0) * (1 + TIE * (1 - enough))


def constraints_of(file: SearchFile) -> tuple[Constraint, ...]:
    """Return the constraints that the configuration asks for."""
    search, settings = file.search, file.search.constraints
    common = settings.common_view
    bounds: list[tuple[str, str, float | None, bool]] = [  # None: it is not asked for
        ("body", "m", 0.0 if _may_be_in_body(search) else None, False),
        ("keep_out", "m", 0.0 if search.keep_out else None, False),
        ("blind_lidars", "", None if file.allow_blind_lidars else 0.0, False),
        ("distance", "m", settings.distance or None, True),
        ("body_share", "", settings.body_share, False),
        ("price", "", settings.price, False),
        ("power", "W", settings.power, False),
        ("common_view", "", None if common is None else common.share, True),
        ("facing", "pairs", settings.facing, False),
    ]
    bounds += [(requirement_name(r.name), r.measured, r.least, True) for r in search.requirements]
    return tuple(
        Constraint(name, unit, float(limit), at_least)
        for name, unit, limit, at_least in bounds
        if limit is not None
    )


def _may_be_in_body(search: SearchSettings) -> bool:
    """Return whether zones, or the images of those with mirrored pairs, reach into the vehicle."""
    vehicle = vehicle_of(search.vehicle)
    zones = [*mountable(search.zones, vehicle)]
    zones += [
        replace(zone, polygon=tuple((x, -y) for x, y in zone.polygon))
        for zone, zone_settings in zip(zones, search.zones.values(), strict=True)
        if zone_settings.mirrored or search.symmetric
    ]
    return any(zone_in_body(zone, vehicle)[0] for zone in zones)


def vehicle_in(file: SearchFile) -> Vehicle:
    """Return the vehicle of a search, or its poles, with all that hides what is behind it."""
    vehicle = vehicle_of(carrier_of(file.search.vehicle, file.search.keep_out))
    return vehicle if file.site is None else poles_at(file.scene, file.site, vehicle)


def requirement_name(name: str) -> str:
    """Return the name of the constraint that a requirement is."""
    return f"requirement.{name}"


@dataclass(frozen=True)
class Carrier:
    """LiDAR models and the vehicle that carries them, on which constraints are measured.

    Attributes:
        totals: price and power, by name of the model; NaN where it is not known.
        mount_prices: by name of the zone.
        limits: limits of mounting.
        vehicle: its body, and what hides what is behind it.
        roi: of which every LiDAR has to see something.
        further: cameras and radars, which every rig has.
        further_totals: price and power of `further`."""

    models: Mapping[str, Lidar]
    totals: Mapping[str, Mapping[str, float]]
    mount_prices: Mapping[str, float]
    limits: Limits
    vehicle: Vehicle
    roi: Roi
    requirements: tuple[RequirementLayout, ...]
    further: tuple[MountedSensor, ...]
    further_totals: Mapping[str, float]

    @classmethod
    def of(
        cls,
        file: SearchFile,
        models: Mapping[str, Lidar],
        requirements: tuple[RequirementLayout, ...],
    ) -> Carrier:
        """Build it from the configuration; `models` by name."""
        settings, further = file.search, file.search.further_settings
        limits = settings.constraints.limits(
            body=vehicle_of(settings.vehicle), keep_out=keep_out_boxes(settings.keep_out)
        )
        # The rig that one has without `search.models` costs nothing more.
        unknown = {"price": math.nan if settings.models else 0.0, "power": math.nan}
        return cls(
            models,
            {
                total: {
                    name: settings.models[name].total(total) if name in settings.models else value
                    for name in models
                }
                for total, value in unknown.items()
            },
            {name: zone.price for name, zone in settings.zones.items()},
            limits,
            vehicle_in(file),
            file.voxel_roi(),
            requirements,
            settings.further(),
            {t: math.fsum(getattr(sensor, t) or 0.0 for sensor in further) for t in TOTALS},
        )

    @property
    def hiding(self) -> Vehicle:
        """Vehicle that hides objects of requirements: the body, at a site the buildings."""
        return self.requirements[0].vehicle if self.requirements else self.vehicle

    def total_of(self, total: str, rig: Rig) -> float:
        """Return price or power of all sensors, with the price of mounts in zones."""
        mounts = self.mount_prices if total == "price" else {}
        lidar_totals = (self.totals[total][c.model] + mounts.get(c.zone, 0.0) for c in rig)
        return math.fsum([*lidar_totals, self.further_totals[total]])

    def requirement_results(self, rig: Rig, name: str = "rig") -> list[RequirementResult]:
        """Check every requirement under a rig."""
        placement = placement_of(rig, self.models, name)
        return check_requirements(self.requirements, placement, self.hiding, self.further)


def _of_requirements(rig: Rig, carrier: Carrier) -> dict[str, float]:
    """Return the worst case of each requirement, by the constraint's name, and `enough.NAME`."""
    names = [requirement_name(layout.requirement.name) for layout in carrier.requirements]
    if not is_possible(rig):
        return dict.fromkeys([*names, *(f"enough.{name}" for name in names)], 0.0)
    measures = {}
    for name, outcome in zip(names, carrier.requirement_results(rig), strict=True):
        measures[name] = outcome.worst.value
        measures[f"enough.{name}"] = min(case.enough for case in outcome.cases)
    return measures


def measures_of(rig: Rig, constraints: Sequence[Constraint], carrier: Carrier) -> dict[str, float]:
    """Return the measure of each constraint, by its name.

    Requirements also have `enough.NAME`: the least share of positions with enough in any case."""
    names = [constraint.name for constraint in constraints]
    has_requirements = any(name.startswith(requirement_name("")) for name in names)
    measures = _of_requirements(rig, carrier) if has_requirements else {}
    placement = placement_of(rig, carrier.models) if is_possible(rig) else None
    others = [name for name in names if name not in measures]
    return measures | {name: _measure(name, rig, placement, carrier) for name in others}


def _measure(name: str, rig: Rig, placement: Placement | None, carrier: Carrier) -> float:
    if name in TOTALS:
        return carrier.total_of(name, rig)
    if placement is None and name not in ("body", "keep_out", "body_share"):
        return float(len(rig)) if name in ("blind_lidars", "facing") else 0.0
    if name == "blind_lidars":
        assert placement is not None
        return float(len(blind_lidars(placement, carrier.roi, carrier.vehicle)))
    # A dead LiDAR takes room and hides objects, but sees nothing.
    counted = [c for c in rig if not c.dead or name in ("body", "keep_out", "body_share")]
    dead = [(c.mount, carrier.models[c.model]) for c in rig if c not in counted]
    lidars = [carrier.models[c.model] for c in counted]
    sensors = MountedSensors([c.mount for c in counted], lidars, carrier.further, dead)
    return worst(name, sensors, carrier.limits, carrier.vehicle)
