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
    """A sampler that suggests the same for a trial however often it is asked, and after any stop.

    All randomness follows from the seed, the number of the trial and the name of the parameter.
    What a sampler has learned it takes from the study, so each suggestion can come from a new one.
    `enqueued`: number of the first trials, whose parameters are set; CMA-ES starts from the best of
    them."""

    def __init__(self, name: str, seed: int, enqueued: int = 0) -> None:
        self._name, self._seed, self._enqueued = name, seed, enqueued
        self._joint: samplers.BaseSampler | None = None

    def _new(
        self, trial: FrozenTrial, parameter: str = "", start: FrozenTrial | None = None
    ) -> samplers.BaseSampler:
        key = (self._seed, trial.number, zlib.crc32(parameter.encode()))
        sampler_seed = int(np.random.SeedSequence(key).generate_state(1)[0])
        with warnings.catch_warnings(action="ignore", category=ExperimentalWarning):
            return sampler_for(self._name, sampler_seed, self._seed, trial.number, start)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Infer the joint space of a trial's parameters."""
        self._joint = self._new(trial)  # some remember the space that they inferred
        return self._joint.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Suggest the parameters of the joint space."""
        if self._name == "cmaes":
            if trial.number < self._enqueued or not search_space:
                return {}  # else Optuna takes what is given for CMA-ES's own first generations
            self._joint = self._new(trial, start=_best_of(study) if self._enqueued else None)
        assert self._joint is not None
        return self._joint.sample_relative(study, trial, search_space)

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        """Suggest a parameter outside of the joint space."""
        sampler = self._new(trial, param_name)
        return sampler.sample_independent(study, trial, param_name, param_distribution)

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """Prepare a trial."""
        self._new(trial).before_trial(study, trial)

    def after_trial(
        self, study: Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """Finish a trial."""
        with warnings.catch_warnings():
            # CMA-ES does without them: what breaks one is not evaluated.
            warnings.filterwarnings("ignore", "Constraints have been set", UserWarning)
            self._new(trial).after_trial(study, trial, state, values)


def _best_of(study: Study) -> FrozenTrial | None:
    """Return the best trial so far; None where none has a value."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    sign = -1 if study.direction == StudyDirection.MAXIMIZE else 1
    return min(complete, key=lambda t: (sign * (t.value or 0.0), t.number), default=None)


def sampler_for(
    name: str, seed: int, common_seed: int, number: int, start: FrozenTrial | None = None
) -> samplers.BaseSampler:
    """Return the sampler called `name` for one suggestion.

    `seed`: of the suggestion; `common_seed`: of all, where they are a sequence; `start`: a trial
    from which CMA-ES starts, with a standard deviation of a tenth of each range (Nomura et al.
    2021); what it has learned since is in the study."""
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
    """A quasi-Monte Carlo sampler that takes the point with the trial's number.

    Optuna's own counts the points that were asked for, and a stop would skip some."""

    def __init__(self, number: int, **options: Any) -> None:
        super().__init__(**options)
        self._number = number

    def _find_sample_id(self, study: Study, search_space: dict[str, BaseDistribution]) -> int:
        return self._number
