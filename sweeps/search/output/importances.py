"""Which parameters of a search matter; optuna-dashboard plots how."""

import warnings

import optuna
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

_LEAST_TRIALS = 10


def importances(study: optuna.Study) -> dict[str, float]:
    """Share of each parameter in reaching good values of the first objective (PED-ANOVA).

    Empty if there are too few trials with a value, or they do not differ.
    """
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    values = {trial.values[0] for trial in complete}
    if len(complete) < _LEAST_TRIALS or len(values) < 2 or not _shared(complete):
        return {}
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    with warnings.catch_warnings(action="ignore"):  # that low is good is known
        return get_param_importances(
            study,
            evaluator=PedAnovaImportanceEvaluator(),
            target=lambda trial: sign * trial.values[0],
        )


def _shared(trials: list[FrozenTrial]) -> set[str]:
    """Parameters that all trials have."""
    return set.intersection(*(set(trial.params) for trial in trials))
