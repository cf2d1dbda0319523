"""What a rig is worth on a traffic: its objectives and constraints."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from lidarplace import ExpectedRecall, OccupancyGrid, evaluate_classes, expected_ig_of_rays
from lidarplace.mounting.errors import MountingErrors, fleet
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, to_ask_for
from sweeps.configuration.search import TOTALS, ObjectiveSettings
from sweeps.configuration.sweep import SurrogateSettings
from sweeps.search.problem.choice import Choices, is_possible, placement_of
from sweeps.search.problem.constraints import Carrier, Constraint, measures_of, requirement_name


@dataclass(frozen=True)
class Traffic:
    """POG by class, empty if none is asked for; objects, for `expected_recall`."""

    grids: Mapping[str, OccupancyGrid]
    objects: ExpectedRecall | None = None


@dataclass(frozen=True)
class Question:
    """What is asked of every rig: surrogates as of `evaluate_classes`, and `expected_recall` as the
    mean over `surrogate.mount_draws` vehicles; measured objectives are not answered here."""

    objectives: tuple[ObjectiveSettings, ...]
    constraints: tuple[Constraint, ...]
    carrier: Carrier
    surrogate: SurrogateSettings
    azimuth_stride: int
    errors: MountingErrors
    seed: int

    @property
    def needs_objects(self) -> bool:
        """Whether a surrogate of single objects is asked for."""
        return any(o.by in OBJECT_SURROGATES for o in self.objectives)


@dataclass(frozen=True)
class Assessment:
    """What was found of a rig: values by objective, without measured ones, None for a rig that
    cannot be; what constraints look at, by how much they are violated, 0 or less if they are kept,
    and the same for the sampler, see `Constraint.told`."""

    values: dict[str, float] | None
    measures: dict[str, float]
    violations: dict[str, float]
    told: dict[str, float]
    seconds: float

    @property
    def feasible(self) -> bool:
        """Whether the rig can be and keeps all constraints."""
        return self.values is not None and all(v <= 0 for v in self.violations.values())


def assess(rig: Choices, question: Question, traffic: Traffic) -> Assessment:
    """Answer the question for one rig."""
    start, limits = time.perf_counter(), question.constraints
    measures = measures_of(rig, limits, question.carrier)
    violations = {c.name: c.violation(measures[c.name]) for c in limits}
    enough = {c.name: measures.get(f"enough.{c.name}", 1.0) for c in limits}
    told = {c.name: c.told(violations[c.name], enough[c.name]) for c in limits}
    values = _values(rig, question, traffic, measures) if is_possible(rig) else None
    return Assessment(values, measures, violations, told, time.perf_counter() - start)


def _values(
    rig: Choices, question: Question, traffic: Traffic, measures: Mapping[str, float]
) -> dict[str, float]:
    found = {}
    recall = _recall(rig, question, traffic.objects) if traffic.objects else {}
    by_class = _of_pog(rig, question, traffic)
    for objective in question.objectives:
        if objective.by in TOTALS:
            found[objective.name] = question.carrier.total_of(objective.by, rig)
        elif objective.by == "margin":
            required = (c for c in question.constraints if c.name.startswith(requirement_name("")))
            found[objective.name] = min(measures[c.name] / c.limit for c in required)
        elif objective.of_traffic:
            weights = objective.weights_of(traffic.grids)
            of_objects = objective.by in OBJECT_SURROGATES
            own = recall if of_objects else {n: by_class[n][objective.by] for n in weights}
            found[objective.name] = math.fsum(w * own[name] for name, w in weights.items())
    return found


def _recall(rig: Choices, question: Question, model: ExpectedRecall) -> dict[str, float]:
    """`expected_recall` by class, the mean over vehicles."""
    rig_as_meant = placement_of(rig, question.carrier.models)
    rigs = fleet(rig_as_meant, question.errors, question.surrogate.mount_draws, question.seed)
    every = [model.recall(seen)["expected_recall"] for seen in model.objects.seen_by(rigs)]
    return {str(k): float(v) for k, v in pd.concat(every, axis=1).mean(axis=1).items()}


def _of_pog(rig: Choices, question: Question, traffic: Traffic) -> dict[str, dict[str, float]]:
    """The surrogates of the POG that are asked for, by class."""
    placement, how = placement_of(rig, question.carrier.models), question.surrogate
    of_pog = {o.by for o in question.objectives if o.of_traffic}.difference(OBJECT_SURROGATES)
    if not of_pog:
        return {}
    q = how.detection_probability
    if of_pog == {"expected_ig"} and not how.occlusion and how.method != "bresenham":
        # The default, for which no cone has to be covered.
        gains = expected_ig_of_rays(traffic.grids, placement, q, question.azimuth_stride)
        return {str(name): {"expected_ig": float(gain)} for name, gain in gains.items()}
    results = evaluate_classes(
        traffic.grids,
        placement,
        how.method,
        surrogates=to_ask_for(sorted(of_pog)),
        detection_probability=q,
        occlusion=how.occlusion,
        azimuth_stride=question.azimuth_stride,
    )
    return {name: {by: own.asked(by) for by in of_pog} for name, own in results.items()}
