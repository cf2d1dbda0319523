"""Optuna's own plots of what parameters matter, as plotly figures in files.

The history of a search and its Pareto front are figures of our own (`tracking.figures`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import optuna
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

from lidarplace.files.atomic import replacing

MOST_SLICES = 8
"""Parameters that the slice plot shows, the most important first."""

MOST_LINES = 300
"""Trials of the parallel coordinate plot, which draws a line for each."""

_LEAST_TRIALS = 10


def importances(study: optuna.Study) -> dict[str, float]:
    """Share of each parameter in reaching good values of the first objective (PED-ANOVA).

    Empty if there are too few trials with a value, or they do not differ.
    """
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    values = {trial.values[0] for trial in complete}
    if len(complete) < _LEAST_TRIALS or len(values) < 2 or not _shared(complete):
        return {}
    with warnings.catch_warnings(action="ignore"):  # that low is good is known, see below
        return get_param_importances(
            study, evaluator=PedAnovaImportanceEvaluator(), target=_low_is_good(study)
        )


def _low_is_good(study: optuna.Study) -> Callable[[FrozenTrial], float]:
    """The first objective as PED-ANOVA wants it."""
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    return lambda trial: sign * trial.values[0]


def write_optuna_figures(study: optuna.Study, names: list[str], folder: Path) -> None:
    """Write `TITLE.json` for every plot that the study has data for.

    Args:
        names: of the objectives.
    """
    from optuna.visualization import (
        plot_parallel_coordinate,
        plot_param_importances,
        plot_slice,
    )

    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.json"):
        old.unlink()
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    first: dict[str, Any] = {"target": lambda trial: trial.values[0], "target_name": names[0]}
    figures = {}
    found = importances(study)
    if found:
        with warnings.catch_warnings(action="ignore"):
            figures["parameter_importances"] = plot_param_importances(
                study,
                evaluator=PedAnovaImportanceEvaluator(),
                target=_low_is_good(study),
                target_name=names[0],
            )
        most = list(found)[:MOST_SLICES]
        figures["slice"] = plot_slice(study, params=most, **first)
        if len(complete) <= MOST_LINES:
            figures["parallel_coordinate"] = plot_parallel_coordinate(study, params=most, **first)
    for title, figure in figures.items():
        with replacing(folder / f"{title}.json") as partial:
            partial.write_text(figure.to_json(), encoding="utf-8")


def _shared(trials: list[FrozenTrial]) -> set[str]:
    """Parameters that all trials have."""
    return set.intersection(*(set(trial.params) for trial in trials))
