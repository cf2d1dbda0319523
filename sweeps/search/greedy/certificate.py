"""Greedy choice from a grid of mounts, and an upper bound on every choice."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lidarplace import Mount, Placement
from lidarplace.configuration.record import read_record
from lidarplace.coverage.rays import ray_weight
from lidarplace.files.atomic import write_text
from lidarplace.pog.selection.tracing import OBJECTIVES
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, RAY_SURROGATES
from sweeps.configuration.file import ConfigError
from sweeps.search.greedy.candidates import candidates_of, limits_of, set_function_of
from sweeps.search.greedy.refine import is_feasible, refine
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.families import family_params
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, ordered
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import assign_to_slots, rig_of

SUBMODULAR = (*OBJECTIVES, "expected_recall")
"""Objectives that have greedy choice and a bound."""


@dataclass(frozen=True)
class _Keyed:
    """Identifier of the search of a certificate."""

    key: str


@dataclass(frozen=True)
class Certificate(_Keyed):
    """Bounds for all placements from a grid of candidate mounts.

    Attributes:
        chosen: greedy's choice, in order; the LiDARs that every rig has are one part.
        gains: value that each part of `chosen` added.
        by_gains: upper bound from marginal gains alone.
        history: how `bound` fell: columns seconds, bound, kind.
        evaluations: marginal gains that greedy choice looked at.
        refined: the best of greedy's rig and of `start` that keep the constraints, each LiDAR moved
            to a better place nearby; None if there is none, or refinement is off.
        refined_from: what it was before: "greedy" or a placement."""

    candidates: int
    chosen: tuple[Rig, ...]
    gains: tuple[float, ...]
    value: float
    by_gains: float
    bound: float
    history: dict[str, list[float | str]]
    evaluations: int
    refined: Rig | None
    refined_value: float | None
    refined_from: str | None
    greedy_seconds: float
    bound_seconds: float
    refine_seconds: float

    @property
    def rig(self) -> Rig:
        """Greedy's rig."""
        return rig_of_parts(self.chosen)


def why_none(problem: SearchProblem) -> str | None:
    """Return why this search has no bound; None if it has one."""
    search = problem.file.search
    if search.greedy is None:
        return "set search.greedy"
    if len(search.objective) > 1:
        return "several objectives have no single best value"
    objective = search.objective[0]
    if objective.by == "residual_entropy":
        return "search.objective covered_entropy asks for the same, and has a bound"
    if objective.by not in SUBMODULAR or objective.best != "maximize":
        return f"{objective.best} {objective.by} is not monotone and submodular in the LiDARs"
    if objective.by in OBJECT_SURROGATES and problem.criteria.surrogate.mount_draws:
        return "surrogate.mount_draws: candidates have exact mounts"
    if objective.by not in RAY_SURROGATES:
        return None
    stride, models = problem.criteria.azimuth_stride, problem.models
    names = {*problem.space.models, *(lidar.model for lidar in problem.space.fixed)}
    # Rays that one stands for, of every model that a rig may have.
    weights = {ray_weight(Placement(name, [Mount()], models[name]), stride) for name in names}
    if len(weights) == 1:
        return None
    return (
        f"search.azimuth_stride {stride} does not divide the azimuth steps of all LiDAR models "
        "evenly; 1 does"
    )


def certify(problem: SearchProblem, traffic: Traffic) -> Certificate | None:
    """Compute greedy choice and its upper bound. None if no candidate keeps the constraints."""
    start = time.perf_counter()
    settings = problem.file.search.greedy
    assert settings is not None
    candidates = candidates_of(problem)
    if not candidates:
        return None
    worth = set_function_of(candidates, problem, traffic)
    limits, _ = limits_of(candidates, problem)
    choice = worth.greedy(limits)
    chosen_after = time.perf_counter()
    bound = worth.upper_bound(limits, choice.chosen, settings.bound_seconds)
    bounded = time.perf_counter()
    chosen = tuple(candidates[i] for i in choice.chosen)
    del worth  # a grid of candidates takes much memory
    starts = dict(problem.start) if settings.refine else {}
    # Greedy leaves out what adds nothing, but every rig has the fixed LiDARs.
    fixed = problem.space.fixed
    chosen += (fixed,) if chosen and fixed and fixed not in chosen else ()
    by_greedy = slots_of(rig_of_parts(chosen), problem)
    if by_greedy is not None and settings.refine:
        starts["greedy"] = by_greedy
    # Greedy does not look at requirements, and a rig that one has may break any constraint.
    constraints = problem.criteria.constraints
    refined, value, origin = None, None, None
    for name, placed in starts.items():
        if not is_feasible(problem, rig_of(placed, problem.space), constraints):
            continue
        moved, moved_value = refine(problem, traffic, placed)
        if value is None or moved_value > value:
            refined, value, origin = rig_of(moved, problem.space), moved_value, name
    return Certificate(
        key=problem.key,
        candidates=len(candidates),
        chosen=chosen,
        gains=(*choice.gains.tolist(), *[0.0] * (len(chosen) - len(choice.chosen))),
        value=choice.value,
        by_gains=bound.by_gains,
        bound=bound.value,
        history={str(name): column.tolist() for name, column in bound.history.items()},
        evaluations=choice.evaluations,
        refined=refined,
        refined_value=value,
        refined_from=origin,
        greedy_seconds=chosen_after - start,
        bound_seconds=bounded - chosen_after,
        refine_seconds=time.perf_counter() - bounded,
    )


def kept_certificate(problem: SearchProblem, traffic: Traffic, path: Path) -> Certificate | None:
    """Return the certificate in `path`, or a new one, stored there.

    Raises ConfigError: the file has another content."""
    if path.exists():
        try:
            if read_record(path, _Keyed, "certificate of a search").key == problem.key:
                return read_record(path, Certificate, "certificate of a search")
        except ValueError as error:
            raise ConfigError(str(error), fix="remove it, and it is made again") from None
    certificate = certify(problem, traffic)
    if certificate is not None:
        write_text(path, json.dumps(asdict(certificate), indent=1))
    return certificate


def rig_of_parts(parts: Sequence[Rig]) -> Rig:
    """Return the rig of all LiDARs of `parts`."""
    return ordered(lidar for part in parts for lidar in part)


def slots_of(rig: Rig, problem: SearchProblem) -> list[Assignment] | None:
    """Return a rig in the slots of the space; None if it does not fit: greedy's may be small."""
    left = [lidar for lidar in rig if lidar not in problem.space.fixed]
    try:
        return assign_to_slots(problem.space, left)
    except ValueError:
        return None


def first_params(problem: SearchProblem, certificate: Certificate | None) -> list[dict[str, Any]]:
    """Return parameters of the first trials: the refined rig or greedy's, `start`, families."""
    search, space, rigs = problem.file.search, problem.space, [*problem.start.values()]
    if certificate is not None and search.greedy is not None and search.greedy.warm_start:
        first = slots_of(certificate.refined or certificate.rig, problem)
        rigs = rigs if first is None else [first, *rigs]
    first_rigs = [space.params(rig) for rig in rigs]
    return first_rigs + family_params(space, problem.models, search.first_families, search.seed)
