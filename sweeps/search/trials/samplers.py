"""Optuna's samplers by name."""

import warnings
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from optuna import samplers
from optuna.distributions import BaseDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.study import Study, StudyDirection
from optuna.trial import FrozenTrial, TrialState


class Repeatable(samplers.BaseSampler):
    """Suggests the same for a trial however often it is asked, and after any stop.

    All randomness follows from the seed, the number of the trial and the name of the parameter.
    What a sampler has learned it takes from the study, so each suggestion can come from a new one.
    `given`: number of the first trials, whose parameters are not asked for; CMA-ES starts from the
    best of them.
    """

    def __init__(self, name: str, seed: int, given: int = 0) -> None:
        self._name, self._seed, self._given = name, seed, given
        self._joint: samplers.BaseSampler | None = None

    def _new(
        self, trial: FrozenTrial, parameter: str = "", start: FrozenTrial | None = None
    ) -> samplers.BaseSampler:
        key = (self._seed, trial.number, zlib.crc32(parameter.encode()))
        own = int(np.random.SeedSequence(key).generate_state(1)[0])
        with warnings.catch_warnings(action="ignore", category=ExperimentalWarning):
            return sampler_for(self._name, own, self._seed, trial.number, start)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        self._joint = self._new(trial)  # some remember the space that they inferred
        return self._joint.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        if self._name == "cmaes":
            if trial.number < self._given or not search_space:
                return {}  # else Optuna takes what is given for CMA-ES's own first generations
            self._joint = self._new(trial, start=_best_of(study) if self._given else None)
        assert self._joint is not None
        return self._joint.sample_relative(study, trial, search_space)

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        own = self._new(trial, param_name)
        return own.sample_independent(study, trial, param_name, param_distribution)

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        self._new(trial).before_trial(study, trial)

    def after_trial(
        self, study: Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        with warnings.catch_warnings():
            # CMA-ES does without them: what breaks one is not evaluated.
            warnings.filterwarnings("ignore", "Constraints have been set", UserWarning)
            self._new(trial).after_trial(study, trial, state, values)


def _best_of(study: Study) -> FrozenTrial | None:
    """The best trial so far; None where none has a value."""
    known = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    sign = -1 if study.direction == StudyDirection.MAXIMIZE else 1
    return min(known, key=lambda trial: (sign * (trial.value or 0.0), trial.number), default=None)


def sampler_for(
    name: str, seed: int, common_seed: int, number: int, start: FrozenTrial | None = None
) -> samplers.BaseSampler:
    """A sampler with the `seed` of one suggestion, `common_seed` of all where they are a sequence,
    and `start`, a trial from which CMA-ES starts, with a standard deviation of a tenth of each
    range (Nomura et al. 2021); what it has learned since is in the study."""
    if name == "tpe":  # jointly: what a LiDAR should see depends on where the others are
        return samplers.TPESampler(seed=seed, multivariate=True, group=True)
    if name == "gp":
        return samplers.GPSampler(
            seed=seed, deterministic_objective=True, warn_independent_sampling=False
        )
    if name == "cmaes":
        # It starts from the best tenth of what it is given.
        source = None if start is None else [start] * 10
        return samplers.CmaEsSampler(
            seed=seed, source_trials=source, warn_independent_sampling=False
        )
    if name == "nsga2":
        return samplers.NSGAIISampler(seed=seed)
    if name == "nsga3":
        return samplers.NSGAIIISampler(seed=seed)
    if name == "random":
        return samplers.RandomSampler(seed=seed)
    assert name == "qmc"
    return _Numbered(
        number,
        seed=common_seed,
        scramble=True,
        independent_sampler=samplers.RandomSampler(seed=seed),  # of the first trial
        warn_independent_sampling=False,
    )


class _Numbered(samplers.QMCSampler):
    """Takes the point of the sequence that has the trial's number; Optuna's own counts the points
    that were asked for, and a stop would skip some."""

    def __init__(self, number: int, **options: Any) -> None:
        super().__init__(**options)
        self._number = number

    def _find_sample_id(self, study: Study, search_space: dict[str, BaseDistribution]) -> int:
        return self._number
