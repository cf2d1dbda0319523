"""Assessment of a rig on a traffic: its objectives and constraints."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from lidarplace import ExpectedRecall, OccupancyGrid, evaluate_classes, expected_ig_of_rays
from lidarplace.mounting.errors import MountingErrors, fleet
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, to_ask_for
from sweeps.configuration.objective import TOTALS, ObjectiveSettings
from sweeps.configuration.point import SurrogateSettings
from sweeps.search.problem.constraints import Carrier, Constraint, measures_of, requirement_name
from sweeps.search.problem.rig import Rig, is_possible, placement_of


@dataclass(frozen=True)
class Traffic:
    """POG by class, empty if no objective needs it; objects for `expected_recall`."""

    grids: Mapping[str, OccupancyGrid]
    objects: ExpectedRecall | None = None


@dataclass(frozen=True)
class Criteria:
    """Objectives and constraints by which every rig is assessed, and how surrogates are computed.

    `expected_recall` is the mean over `surrogate.mount_draws` vehicles; values that detectors
    measure are not part of an assessment."""

    objectives: tuple[ObjectiveSettings, ...]
    constraints: tuple[Constraint, ...]
    carrier: Carrier
    surrogate: SurrogateSettings
    azimuth_stride: int
    errors: MountingErrors
    seed: int

    @property
    def needs_objects(self) -> bool:
        """Whether an objective is a surrogate of single objects."""
        return any(o.by in OBJECT_SURROGATES for o in self.objectives)


@dataclass(frozen=True)
class Assessment:
    """Objectives and constraints of one rig.

    Attributes:
        values: by objective, without measured ones; None for an impossible rig.
        measures: the measured quantity of each constraint, by its name, and `enough.NAME`.
        violations: by how much each constraint is violated; 0 or less if it is kept.
        sampler_violations: the same for the sampler, see `Constraint.sampler_violation`.
        seconds: duration of the assessment."""

    values: dict[str, float] | None
    measures: dict[str, float]
    violations: dict[str, float]
    sampler_violations: dict[str, float]
    seconds: float

    @property
    def feasible(self) -> bool:
        """Whether the rig is possible and keeps all constraints."""
        return self.values is not None and all(v <= 0 for v in self.violations.values())


def assess(rig: Rig, criteria: Criteria, traffic: Traffic) -> Assessment:
    """Compute objectives and constraints of one rig."""
    start, limits = time.perf_counter(), criteria.constraints
    measures = measures_of(rig, limits, criteria.carrier)
    violations = {c.name: c.violation(measures[c.name]) for c in limits}
    enough = {c.name: measures.get(f"enough.{c.name}", 1.0) for c in limits}
    scaled = {c.name: c.sampler_violation(violations[c.name], enough[c.name]) for c in limits}
    values = _values(rig, criteria, traffic, measures) if is_possible(rig) else None
    return Assessment(values, measures, violations, scaled, time.perf_counter() - start)


def _values(
    rig: Rig, criteria: Criteria, traffic: Traffic, measures: Mapping[str, float]
) -> dict[str, float]:
    values = {}
    recall = _recall(rig, criteria, traffic.objects) if traffic.objects else {}
    by_class = _of_pog(rig, criteria, traffic)
    for objective in criteria.objectives:
        if objective.by in TOTALS:
            values[objective.name] = criteria.carrier.total_of(objective.by, rig)
        elif objective.by == "margin":
            required = (c for c in criteria.constraints if c.name.startswith(requirement_name("")))
            values[objective.name] = min(measures[c.name] / c.limit for c in required)
        elif objective.of_traffic:
            weights = objective.weights_of(traffic.grids)
            of_objects = objective.by in OBJECT_SURROGATES
            by_name = recall if of_objects else {n: by_class[n][objective.by] for n in weights}
            values[objective.name] = math.fsum(w * by_name[name] for name, w in weights.items())
    return values


def _recall(rig: Rig, criteria: Criteria, model: ExpectedRecall) -> dict[str, float]:
    """Return `expected_recall` by class, the mean over vehicles."""
    rig_as_meant = placement_of(rig, criteria.carrier.models)
    rigs = fleet(rig_as_meant, criteria.errors, criteria.surrogate.mount_draws, criteria.seed)
    every = [model.recall(seen)["expected_recall"] for seen in model.objects.seen_by(rigs)]
    return {str(k): float(v) for k, v in pd.concat(every, axis=1).mean(axis=1).items()}


def _of_pog(rig: Rig, criteria: Criteria, traffic: Traffic) -> dict[str, dict[str, float]]:
    """Return the surrogates of the POG that are objectives, by class."""
    placement, settings = placement_of(rig, criteria.carrier.models), criteria.surrogate
    of_pog = {o.by for o in criteria.objectives if o.of_traffic}.difference(OBJECT_SURROGATES)
    if not of_pog:
        return {}
    q = settings.detection_probability
    if of_pog == {"expected_ig"} and not settings.occlusion and settings.method != "bresenham":
        # The default, for which no cone has to be covered.
        gains = expected_ig_of_rays(traffic.grids, placement, q, criteria.azimuth_stride)
        return {str(name): {"expected_ig": float(gain)} for name, gain in gains.items()}
    results = evaluate_classes(
        traffic.grids,
        placement,
        settings.method,
        surrogates=to_ask_for(sorted(of_pog)),
        detection_probability=q,
        occlusion=settings.occlusion,
        azimuth_stride=criteria.azimuth_stride,
    )
    return {name: {by: result.asked(by) for by in of_pog} for name, result in results.items()}
