"""What sets of candidates are worth to the objective, of voxels or of objects."""

from collections.abc import Sequence
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from lidarplace.pog.selection import Exposure, Greedy, Limits, UpperBound, VoxelChoice
from lidarplace.pog.selection.tracing import OBJECTIVES, Objective
from lidarplace.recall.choice import RecallChoice
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.choice import Choices, placement_of
from sweeps.search.problem.problem import Problem

SUBMODULAR = (*OBJECTIVES, "expected_recall")
"""Objectives that have greedy choice and a bound."""


class Worth(Protocol):
    """Value of every set of some candidates, monotone and submodular."""

    def value(self, chosen: Sequence[int]) -> float:
        """The value of a set."""

    def gains(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """What each candidate adds to a set, shape (candidates,)."""

    def greedy(self, limits: Limits) -> Greedy:
        """Greedy choice."""

    def upper_bound(self, limits: Limits, chosen: Sequence[int], seconds: float) -> UpperBound:
        """What no set exceeds; `chosen`: greedy's."""


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
