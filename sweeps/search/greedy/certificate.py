"""How good a search can be: greedy choice from a grid of mounts, and what no choice exceeds."""

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
from sweeps.search.greedy.candidates import candidates_of, limits_of, worth_of
from sweeps.search.greedy.refine import keeps, refine
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.choice import Choices, ordered
from sweeps.search.problem.families import family_params
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.space import Placed, placed_in, rig_of

SUBMODULAR = (*OBJECTIVES, "expected_recall")
"""Objectives that have greedy choice and a bound."""


@dataclass(frozen=True)
class _Keyed:
    """What identifies the problem of a certificate: `key` of both."""

    key: str


@dataclass(frozen=True)
class Certificate(_Keyed):
    """What is known of all placements from a grid of candidate mounts.

    Attributes:
        chosen, gains: what greedy choice took, in order, the LiDARs that every rig has as one; and
            what each of them added.
        by_gains: upper bound from marginal gains alone.
        history: how `bound` fell: columns seconds, bound, kind.
        evaluations: marginal gains that greedy choice looked at.
        refined: the best of greedy's rig and of `start` that keep the constraints, each LiDAR moved
            to a better place around its own; None if there is none, or it was not asked for.
        refined_from: what it was before: "greedy" or a placement.
    """

    candidates: int
    chosen: tuple[Choices, ...]
    gains: tuple[float, ...]
    value: float
    by_gains: float
    bound: float
    history: dict[str, list[float | str]]
    evaluations: int
    refined: Choices | None
    refined_value: float | None
    refined_from: str | None
    greedy_seconds: float
    bound_seconds: float
    refine_seconds: float

    @property
    def rig(self) -> Choices:
        """Greedy's rig."""
        return rig_of_parts(self.chosen)


def why_none(problem: Problem) -> str | None:
    """Why this search has no bound; None if it has one."""
    search = problem.file.search
    if search.greedy is None:
        return "search.greedy is null"
    if len(search.objective) > 1:
        return "several objectives have no single best value"
    objective = search.objective[0]
    if objective.by == "residual_entropy":
        return "search.objective covered_entropy asks for the same, and has a bound"
    if objective.by not in SUBMODULAR or objective.best != "maximize":
        return f"{objective.best} {objective.by} is not monotone and submodular in the LiDARs"
    if objective.by in OBJECT_SURROGATES and problem.question.surrogate.mount_draws:
        return "surrogate.mount_draws: candidates have exact mounts"
    if objective.by not in RAY_SURROGATES:
        return None
    stride, models = problem.question.azimuth_stride, problem.models
    names = {*problem.space.models, *(lidar.model for lidar in problem.space.fixed)}
    # Rays that one stands for, of every model that a rig may have.
    weights = {ray_weight(Placement(name, [Mount()], models[name]), stride) for name in names}
    if len(weights) == 1:
        return None
    return (
        f"search.azimuth_stride {stride} does not divide the azimuth steps of all LiDAR models "
        "evenly; 1 does"
    )


def certify(problem: Problem, traffic: Traffic) -> Certificate | None:
    """Greedy choice and its upper bound. None if no candidate keeps the constraints."""
    start = time.perf_counter()
    settings = problem.file.search.greedy
    assert settings is not None
    candidates = candidates_of(problem)
    if not candidates:
        return None
    worth = worth_of(candidates, problem, traffic)
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
    asked = problem.question.constraints
    kept = (n for n in starts if keeps(problem, rig_of(starts[n], problem.space), asked))
    starts = {name: starts[name] for name in kept}
    refined, value, origin = None, None, None
    for name, placed in starts.items():
        moved, own = refine(problem, traffic, placed)
        if value is None or own > value:
            refined, value, origin = rig_of(moved, problem.space), own, name
    return Certificate(
        key=problem.key,
        candidates=len(candidates),
        chosen=chosen,
        gains=(*choice.gains.tolist(), *[0.0] * (len(chosen) - len(choice.chosen))),
        value=choice.value,
        by_gains=bound.by_gains,
        bound=bound.value,
        history={str(name): own.tolist() for name, own in bound.history.items()},
        evaluations=choice.evaluations,
        refined=refined,
        refined_value=value,
        refined_from=origin,
        greedy_seconds=chosen_after - start,
        bound_seconds=bounded - chosen_after,
        refine_seconds=time.perf_counter() - bounded,
    )


def kept_certificate(problem: Problem, traffic: Traffic, path: Path) -> Certificate | None:
    """That in `path`, or a new one, kept there. Raises ConfigError: it holds something else."""
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


def rig_of_parts(parts: Sequence[Choices]) -> Choices:
    """The rig of all LiDARs of `parts`."""
    return ordered(lidar for part in parts for lidar in part)


def slots_of(rig: Choices, problem: Problem) -> list[Placed] | None:
    """A rig of the space in its slots; None if it is none, as greedy's may have too few LiDARs."""
    left = [lidar for lidar in rig if lidar not in problem.space.fixed]
    try:
        return placed_in(problem.space, left)
    except ValueError:
        return None


def first_params(problem: Problem, certificate: Certificate | None) -> list[dict[str, Any]]:
    """Parameters of the trials to begin with: the refined rig or greedy's, `start`, families."""
    search, space, rigs = problem.file.search, problem.space, [*problem.start.values()]
    if certificate is not None and search.greedy is not None and search.greedy.warm_start:
        first = slots_of(certificate.refined or certificate.rig, problem)
        rigs = rigs if first is None else [first, *rigs]
    given = [space.params(own) for own in rigs]
    return given + family_params(space, problem.models, search.first_families, search.seed)
