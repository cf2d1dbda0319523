"""What sets of candidates are worth to the objective, of voxels or of objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lidarplace.recall.choice import RecallChoice
from lidarplace.selection import Exposure, Greedy, Limits, UpperBound, gains, greedy, upper_bound
from lidarplace.selection.tracing import OBJECTIVES
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.traffic import Traffic

SUBMODULAR = (*OBJECTIVES, "expected_recall")
"""Objectives that have greedy choice and a bound."""


class Worth(Protocol):
    """Value of every set of some candidates: monotone and submodular."""

    def value(self, chosen: Sequence[int]) -> float:
        """The value of a set."""

    def gains(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """What each candidate adds to a set, shape (candidates,)."""

    def greedy(self, limits: Limits) -> Greedy:
        """Greedy choice."""

    def upper_bound(self, limits: Limits, chosen: Sequence[int], seconds: float) -> UpperBound:
        """What no set exceeds; `chosen`: greedy's."""


@dataclass(frozen=True, eq=False)
class VoxelWorth:
    """The worth of what candidates see of the POG."""

    exposure: Exposure

    def value(self, chosen: Sequence[int]) -> float:
        return self.exposure.value(chosen)

    def gains(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        return gains(self.exposure, chosen)

    def greedy(self, limits: Limits) -> Greedy:
        return greedy(self.exposure, limits)

    def upper_bound(self, limits: Limits, chosen: Sequence[int], seconds: float) -> UpperBound:
        return upper_bound(self.exposure, limits, chosen, seconds=seconds)


def worth_of(rigs: Sequence[Choices], problem: Problem, traffic: Traffic) -> Worth:
    """What each of `rigs`, parts of a whole, adds to the objective as the search computes it."""
    question = problem.question
    objective = question.objectives[0]
    weights = objective.weights_of(traffic.grids)
    placements = [placement_of(rig, problem.models) for rig in rigs]
    if objective.by == "expected_recall":
        model = traffic.objects
        assert model is not None
        return RecallChoice(model, model.objects.seen_by(placements), weights)
    return VoxelWorth(
        Exposure.of_candidates(
            traffic.grids,
            weights,
            placements,
            objective.by,
            question.method,
            question.detection_probability,
            question.occlusion,
            question.azimuth_stride,
        )
    )
