"""What a search has found."""

from collections.abc import Mapping
from dataclasses import dataclass

import optuna
import pandas as pd
from optuna.trial import FrozenTrial

from lidarplace import OccupancyGrid
from lidarplace.pog.surrogates.evaluate import FAINT_Q, expected_ig_by_q, linear_share
from sweeps.search.greedy.certificate import Certificate
from sweeps.search.judgement.winners import Judged
from sweeps.search.problem.assess import Question
from sweeps.search.problem.choice import placement_of
from sweeps.search.trials.study import Timing


@dataclass(frozen=True)
class Found:
    """What a search has found.

    Attributes:
        study, trials: Optuna's, and its best trials.
        certificate: None if there is none, for the reason `no_certificate`.
        judged: rigs with all rays by name: found_1, ..., greedy, and the paper's, each the best
            first.
        robustness: table; None if it was not asked for, or nothing was found.
        grids: POG by class; empty if no surrogate was asked for.
        timing: where the driver's time went.
        linear_share: `best_linear_share`.
        chosen: what the generalist measured on the traffic of the choice; None without one.
    """

    study: optuna.Study
    trials: list[FrozenTrial]
    certificate: Certificate | None
    no_certificate: str | None
    judged: Mapping[str, Judged]
    robustness: pd.DataFrame | None
    grids: Mapping[str, OccupancyGrid]
    timing: Timing
    linear_share: float | None
    chosen: pd.DataFrame | None = None

    @property
    def best(self) -> list[str]:
        """Names of the rigs that were found, the best first."""
        return [name for name, own in self.judged.items() if own.role == "found"]

    @property
    def baseline(self) -> str:
        """The best of the paper's eight."""
        return baseline_of(self.judged)


def best_linear_share(
    judged: Mapping[str, Judged], grids: Mapping[str, OccupancyGrid], question: Question
) -> float | None:
    """`linear_share` of `expected_ig` of the best rig that was found, the largest of the classes.

    None if nothing was found, or `expected_ig` is no objective.
    """
    best = next((own.rig for own in judged.values() if own.role == "found"), None)
    if best is None or not any(o.by == "expected_ig" for o in question.objectives):
        return None
    q = question.detection_probability
    rig = placement_of(best, question.carrier.models)
    return float(linear_share(expected_ig_by_q(grids, rig, [q, FAINT_Q]), q).max())


def baseline_of(judged: Mapping[str, Judged]) -> str:
    """The best of the paper's eight among rigs of which the best come first."""
    return next(name for name, own in judged.items() if own.role == "paper")
