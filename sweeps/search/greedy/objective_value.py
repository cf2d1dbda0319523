"""What sets of candidates are worth to the objective, of voxels or of objects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from lidarplace.pog.selection import Exposure, Greedy, Limits, UpperBound, VoxelChoice
from lidarplace.pog.selection.tracing import OBJECTIVES, Objective
from lidarplace.recall.choice import RecallChoice
from lidarplace.recall.one_dead import OneDeadChoice
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem

SUBMODULAR = (*OBJECTIVES, "expected_recall")
"""Objectives that have greedy choice and a bound."""


class Worth(Protocol):
    """Value of every set of some candidates: monotone, and submodular unless it says else."""

    def value(self, chosen: Sequence[int]) -> float:
        """The value of a set."""

    def gains(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """What each candidate adds to a set, shape (candidates,)."""

    def greedy(self, limits: Limits) -> Greedy:
        """Greedy choice."""

    def upper_bound(self, limits: Limits, chosen: Sequence[int], seconds: float) -> UpperBound:
        """What no set exceeds; `chosen`: greedy's."""


@dataclass(frozen=True, eq=False)
class OneDeadWorth:
    """The worth of what candidates find with any one LiDAR dead, which is not submodular.

    Greedy choice optimizes what all LiDARs find, and has no guarantee. The bound holds: a rig
    without its worst LiDAR finds no more than without any other one, which is a rig of one LiDAR
    less.
    """

    choice: OneDeadChoice

    def value(self, chosen: Sequence[int]) -> float:
        return self.choice.value(chosen)

    def gains(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        return self.choice.gains(chosen)

    def greedy(self, limits: Limits) -> Greedy:
        whole = self.choice.whole.greedy(limits)
        sizes = range(1, len(whole.chosen) + 1)
        values = np.array([self.value(whole.chosen[:size]) for size in sizes])
        return replace(whole, gains=np.diff(values, prepend=0.0), values=values)

    def upper_bound(self, limits: Limits, chosen: Sequence[int], seconds: float) -> UpperBound:
        return self.choice.whole.upper_bound(one_lidar_less(limits), chosen, seconds=seconds)


def one_lidar_less(limits: Limits) -> Limits:
    """Of `limits_of`, one LiDAR less; as they are where candidates are pairs.

    Of a rig of pairs what a dead LiDAR leaves is no set of candidates.
    """
    lidars = limits.used[0]
    if (lidars > 1).any():
        return limits
    budgets = limits.budgets.copy()
    budgets[0] -= 1
    return replace(limits, budgets=budgets)


def worth_of(rigs: Sequence[Choices], problem: Problem, traffic: Traffic) -> Worth:
    """What each of `rigs`, parts of a whole, adds to the objective as the search computes it."""
    question = problem.question
    objective = question.objectives[0]
    weights = objective.weights_of(traffic.grids)
    placements = [placement_of(rig, problem.models) for rig in rigs]
    if objective.one_lidar_dead:
        return OneDeadWorth(_with_one_dead(rigs, problem, traffic))
    if objective.by == "expected_recall":
        model = traffic.objects
        assert model is not None
        return RecallChoice(model, model.objects.seen_by(placements), weights)
    return VoxelChoice(
        Exposure.of_candidates(
            traffic.grids,
            weights,
            placements,
            cast(Objective, objective.by),
            question.method,
            question.detection_probability,
            question.occlusion,
            question.azimuth_stride,
        )
    )


def _with_one_dead(rigs: Sequence[Choices], problem: Problem, traffic: Traffic) -> OneDeadChoice:
    """Candidates by what each of their LiDARs finds."""
    model, objective = traffic.objects, problem.question.objectives[0]
    assert model is not None
    alone = [placement_of((lidar,), problem.models) for rig in rigs for lidar in rig]
    seen = iter(model.objects.seen_by(alone))
    return OneDeadChoice.of(
        model, [[next(seen) for _ in rig] for rig in rigs], objective.weights_of(traffic.grids)
    )
