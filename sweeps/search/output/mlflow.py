"""What MLflow shows of a search: a text, columns, and a run for every trial."""

import math
from collections.abc import Iterator
from functools import partial

import optuna
from optuna.trial import FrozenTrial

from sweeps.search.output.tables import rig_columns
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import assessment_of, candidate_of, finished_trials
from tracking.mlflow.content import EndedTrial, TrialRun

ABOUT = """\
A search for a LiDAR placement: one parent run, and a child run for every trial.

- Metrics: the objectives by their names; `feasible` is 1 where all constraints are kept;
  `violation.NAME` is by how much a constraint is missed, 0 or less where it is kept; `seconds`.
- Parameters: where each LiDAR sits, `lidar_1.x_m` and so on, and the values of `search.space`.
- A trial on top that is not feasible is no answer: filter by ``metrics.feasible = 1``.
- The parent run has the command, the configuration, the report and the tables. The best trials
  are evaluated again with all rays: `search.json` and the report have those values.
"""
"""What the experiment's page tells, Markdown."""


def columns(problem: Problem) -> list[str]:
    """What the experiment's page shows of every trial; the first objective orders them."""
    objectives = [objective.name for objective in problem.file.search.objective]
    violations = [f"violation.{limit.name}" for limit in problem.question.constraints]
    metrics = [f"metrics.{name}" for name in (*objectives, "feasible", *violations)]
    return [*metrics, *(f"params.{path}" for path in problem.file.search.space), "metrics.seconds"]


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
