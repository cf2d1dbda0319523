"""The grid of candidate mounts: which ones fit together, and the value of every set of them."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.spatial.distance import cdist

from lidarplace import Mount
from lidarplace.base.errors import InputError
from lidarplace.configuration.mounting import Pair
from lidarplace.mounting.limits import ROUNDING
from lidarplace.mounting.zone import Zone, grid
from lidarplace.pog.selection import Exposure, Limits, VoxelChoice
from lidarplace.pog.selection.tracing import Objective
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.recall.choice import RecallChoice
from sweeps.configuration.objective import TOTALS
from sweeps.configuration.search import GreedySettings, SearchSettings
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.constraints import measures_of
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import MountedLidar, Rig, is_possible, placement_of, rounded
from sweeps.search.problem.slots import Assignment, MountSlot
from sweeps.search.problem.space import Space


def candidates_of(problem: SearchProblem) -> list[Rig]:
    """Return the grid: one LiDAR or mirrored pair each, and the fixed LiDARs as one candidate.

    Candidates that no rig can have are left out: inside of the body, too much of it in view,
    nothing of the ROI in view, or the two of a pair, or one of the fixed LiDARs, too near."""
    fixed = problem.space.fixed
    points = grid_points(problem)
    lidars = ((slot, MountedLidar(model, zone.name, m)) for slot, model, zone, m in points)
    rigs = (Assignment(slot, lidar).rig for slot, lidar in lidars)
    candidates = dict.fromkeys(rig for rig in rigs if _is_allowed(rig, fixed, problem))
    return [*([fixed] if fixed else []), *candidates]


def _number_of_candidates(problem: SearchProblem) -> int:
    """Return the number of mounts of the grid, before some are left out.

    By extents first: a grid of a million points need not be made to be rejected."""
    settings = problem.file.search.greedy
    assert settings is not None
    about = sum(
        _about(zone, settings)
        * math.prod(2 * _reach(span, settings) + 1 for span in slot.spans[model].values())
        for slot in _kinds(problem.space)
        for model, zone in itertools.product(slot.models, slot.zones)
    )
    return about if about > 10 * settings.most else sum(1 for _ in grid_points(problem))


def check_grid(problem: SearchProblem) -> int:
    """Return the mounts of the grid. Raises ValueError if it is finer than the settings allow."""
    settings, number = problem.file.search.greedy, _number_of_candidates(problem)
    assert settings is not None
    if number > settings.most:
        expected = f"at most {settings.most:,} candidates"
        fix = "enlarge position_step or angle_step_deg, or set `greedy: null`"
        raise InputError(key="search.greedy", expected=expected, found=f"{number:,}", fix=fix)
    return number


def _about(zone: Zone, settings: GreedySettings) -> int:
    """Return the points of the grid of a box around the zone."""
    ys = [y for _, y in zone.polygon]
    spans = (zone.x, (min(ys), max(ys)), zone.z)
    return math.prod(int((high - low) / settings.position_step) + 1 for low, high in spans)


def _reach(span: Pair, settings: GreedySettings) -> int:
    """Return the steps from the middle of a span to its ends."""
    return math.floor((span[1] - span[0]) / (2 * settings.angle_step_deg) + 1e-9)


def grid_points(problem: SearchProblem) -> Iterator[tuple[MountSlot, str, Zone, Mount]]:
    """Yield slot, model, zone and pose of every candidate; of a pair those of the left one."""
    settings, space = problem.file.search.greedy, problem.space
    assert settings is not None
    for slot in _kinds(space):
        for model, zone in itertools.product(slot.models, slot.zones):
            levels = (_levels(span, settings) for span in slot.spans[model].values())
            turns = [tuple(map(math.radians, turn)) for turn in itertools.product(*levels)]
            places = grid(zone, settings.position_step).tolist()
            for place, turn in itertools.product(places, turns):
                yield slot, model, zone, rounded(*place, *turn)


def _kinds(space: Space) -> list[MountSlot]:
    """Return a slot of each kind: a single LiDAR and a mirrored pair, of all zones or of each."""
    slots: dict[tuple[bool, tuple[Zone, ...]], MountSlot] = {}
    for counts_per_zone in space.all_counts:
        for slot in space.slots(counts_per_zone):
            slots.setdefault((slot.pair, slot.zones), slot)
    return list(slots.values())


def _levels(span: Pair, settings: GreedySettings) -> list[float]:
    """Return multiples of the step from the middle of the span, degrees."""
    reach = _reach(span, settings)
    return [sum(span) / 2 + i * settings.angle_step_deg for i in range(-reach, reach + 1)]


def _is_allowed(rig: Rig, fixed: Rig, problem: SearchProblem) -> bool:
    limits = {limit.name: limit for limit in problem.criteria.constraints}

    def keeps(part: Rig, *names: str) -> bool:
        constraints = [limits[name] for name in names if name in limits]
        measures = measures_of(part, constraints, problem.criteria.carrier)
        return all(limit.violation(measures[limit.name]) <= 0 for limit in constraints)

    return (
        is_possible(rig + fixed)
        and keeps(rig + fixed, "distance")
        and keeps(rig, "body", "keep_out", "blind_lidars")
        and all(keeps((lidar,), "body_share") for lidar in rig)  # others can only add to it
    )


@dataclass(frozen=True, eq=False)
class CountLimits(Limits):
    """Limits whose sets also leave room for the least numbers of LiDARs of zones and models.

    `completes`: whether candidates are a part of a rig that keeps all counts."""

    completes: Callable[[tuple[int, ...]], bool] = lambda chosen: True

    def allows(self, chosen: list[int], candidate: int) -> bool:
        """Return whether `candidate` may join the set `chosen`."""
        return super().allows(chosen, candidate) and self.completes((*chosen, candidate))


def limits_of(candidates: Sequence[Rig], problem: SearchProblem) -> tuple[CountLimits, np.ndarray]:
    """Return the budgets of a choice, and the least of each budget that has to be used.

    Budgets are the counts, in all, by zone and by model, the number of single LiDARs next to pairs,
    totals, and distances."""
    space, search, carrier = problem.space, problem.file.search, problem.criteria.carrier
    sizes = np.array([0 if rig == space.fixed else len(rig) for rig in candidates], float)
    parts = [() if rig == space.fixed else rig for rig in candidates]
    rows: list[tuple[np.ndarray, float, float]] = [
        (np.array([bound.number(part) for part in parts], float), bound.low, bound.high)
        for bound in space.bounds
    ]
    if search.symmetric:
        odd = any(number % 2 for number in space.numbers)
        rows.append(((sizes == 1).astype(float), 0.0, odd))
    for total in TOTALS:
        most = getattr(search.constraints, total)
        if most is not None:  # what every rig has is paid for first
            used_by = np.array([carrier.total_of(total, rig) for rig in candidates])
            used_by = np.where(sizes > 0, used_by - carrier.further_totals[total], 0.0)
            rows.append((used_by, 0.0, max(0.0, most - carrier.total_of(total, space.fixed))))
    used, least, budgets = (np.array(column, float) for column in zip(*rows, strict=True))

    def completes(chosen: tuple[int, ...]) -> bool:
        return space.completes([parts[i] for i in chosen if parts[i]])

    return CountLimits(used, budgets, _compatible(candidates, search), completes), least


def _compatible(candidates: Sequence[Rig], search: SearchSettings) -> np.ndarray:
    """Return which candidates are far enough from each other."""
    places = np.array([lidar.mount.position for rig in candidates for lidar in rig])
    first = np.concatenate([[0], np.cumsum([len(rig) for rig in candidates])[:-1]])
    near = cdist(places, places) < max(search.constraints.distance, 2 * ROUNDING) - ROUNDING
    by_row = np.logical_or.reduceat(near, first, axis=0)
    apart = ~np.logical_or.reduceat(by_row, first, axis=1)
    np.fill_diagonal(apart, True)
    return apart


def set_function_of(
    rigs: Sequence[Rig], problem: SearchProblem, traffic: Traffic
) -> RecallChoice | VoxelChoice:
    """Return the value of every set of `rigs`, parts of a whole, as the search computes it."""
    criteria, objective = problem.criteria, problem.criteria.objectives[0]
    weights = objective.weights_of(traffic.grids)
    placements = [placement_of(rig, problem.models) for rig in rigs]
    if objective.by == "expected_recall":
        model = traffic.objects
        assert model is not None
        return RecallChoice(model, model.objects.seen_by(placements), weights)
    by, settings = cast(Objective, objective.by), criteria.surrogate
    q, occlusion = settings.detection_probability, settings.occlusion
    sensing = Sensing(settings.method, q, occlusion, criteria.azimuth_stride)
    exposure = Exposure.of_candidates(traffic.grids, weights, placements, by, sensing)
    return VoxelChoice(exposure)
