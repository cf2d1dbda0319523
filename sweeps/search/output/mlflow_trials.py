"""What the runs of a search's trials at MLflow are to hold."""

import math
from collections.abc import Iterator
from functools import partial

import optuna
from optuna.trial import FrozenTrial

from sweeps.search.output.tables import rig_columns
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import assessment_of, candidate_of, finished_trials
from tracking.mlflow.content import EndedTrial, TrialRun


def ended_trials(study: optuna.Study, problem: Problem) -> Iterator[EndedTrial]:
    """All trials of which something was found."""
    for trial in finished_trials(study):
        describe = partial(_trial_run, trial, problem)
        yield EndedTrial(str(trial.number), describe, trial.user_attrs.get("failure"))


def _trial_run(trial: FrozenTrial, problem: Problem) -> TrialRun:
    objectives = problem.file.search.objective
    found, candidate = assessment_of(trial), candidate_of(trial, problem.space)
    values = trial.values or [math.nan] * len(objectives)
    metrics = {o.name: v for o, v in zip(objectives, values, strict=True)}
    metrics |= {f"violation.{name}": v for name, v in found.violations.items()}
    params = {
        name: f"{value:.6g}" if isinstance(value, float) else value
        for name, value in rig_columns(candidate.rig).items()
    }
    assert trial.datetime_complete is not None
    return TrialRun(
        f"trial {trial.number}",
        params | dict(candidate.values) | {"state": trial.state.name},
        metrics | {"seconds": found.seconds, "feasible": float(found.feasible)},
        ended=round(1000 * trial.datetime_complete.timestamp()),
    )
