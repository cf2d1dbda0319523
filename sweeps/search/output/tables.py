"""Tables of a search, with units in the names of their columns, and MLflow's runs."""

import math
import warnings
from collections.abc import Iterator
from functools import partial
from itertools import accumulate
from typing import Any

import optuna
import pandas as pd
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

from lidarplace.base.number_text import number
from sweeps.search.greedy.certificate import Certificate
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import MountedLidar, Rig
from sweeps.search.trials.study import assessment_of, finished_trials
from tracking.mlflow.content import EndedTrial, TrialRun


def mount_columns(lidar: MountedLidar) -> dict[str, Any]:
    """Return a LiDAR as columns, metres and degrees."""
    mount = lidar.mount
    angles = {f"{n}_deg": math.degrees(getattr(mount, n)) for n in ("roll", "pitch", "yaw")}
    place = {"x_m": mount.x, "y_m": mount.y, "z_m": mount.z}
    return {"model": lidar.model, "zone": lidar.zone} | place | angles


def rig_columns(rig: Rig) -> dict[str, Any]:
    """Return all LiDARs of a rig as columns: `lidar_1.model`, `lidar_1.x_m`, ..."""
    return {
        f"lidar_{i}.{name}": value
        for i, lidar in enumerate(rig, start=1)
        for name, value in mount_columns(lidar).items()
    }


def trials_table(study: optuna.Study, problem: SearchProblem) -> pd.DataFrame:
    """Return a row for each trial."""
    objectives = problem.file.search.objective
    rows = []
    for trial in finished_trials(study):
        assessment, rig = assessment_of(trial), problem.space.rig(trial.params)
        values = trial.values or [math.nan] * len(objectives)
        rows.append(
            {"number": trial.number, "state": trial.state.name, "feasible": assessment.feasible}
            | {"possible": assessment.values is not None}
            | {f"value.{o.name}": v for o, v in zip(objectives, values, strict=True)}
            | {f"violation.{name}": v for name, v in assessment.violations.items()}
            | {name: v for name, v in assessment.measures.items() if name.startswith("enough.")}
            | {"seconds": assessment.seconds, "failure": trial.user_attrs.get("failure", "")}
            | {"lidars": len(rig), **rig_columns(rig)}
        )
    return pd.DataFrame(rows)


def greedy_table(certificate: Certificate) -> pd.DataFrame:
    """Return a row for each step of greedy choice: step, gain, value, and the added LiDARs."""
    steps = zip(certificate.gains, accumulate(certificate.gains), certificate.chosen, strict=True)
    return pd.DataFrame(
        {"step": step, "gain": gain, "value": value} | rig_columns(rig)
        for step, (gain, value, rig) in enumerate(steps, start=1)
    )


_LEAST_TRIALS = 10


def importances(study: optuna.Study) -> dict[str, float]:
    """Return the share of each parameter in good values of the first objective (PED-ANOVA).

    Empty if there are too few trials with a value, or they do not differ."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    values = {trial.values[0] for trial in complete}
    if len(complete) < _LEAST_TRIALS or len(values) < 2:
        return {}
    if not set.intersection(*(set(trial.params) for trial in complete)):
        return {}
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    with warnings.catch_warnings(action="ignore"):  # that low is good is known
        return get_param_importances(
            study,
            evaluator=PedAnovaImportanceEvaluator(),
            target=lambda trial: sign * trial.values[0],
        )


ABOUT = """\
A search for a LiDAR placement: one parent run, and a child run for every trial.

- Metrics: the objectives by their names; `feasible` is 1 where all constraints are kept;
  `violation.NAME` is by how much a constraint is missed, 0 or less where it is kept; `seconds`.
- Parameters: where each LiDAR sits, `lidar_1.x_m` and so on.
- A trial on top that is not feasible is no answer: filter by ``metrics.feasible = 1``.
- The parent run has the command, the configuration, the report and the tables. The best trials
  are evaluated again with all rays: `search.json` and the report have those values.
"""
"""Text of the experiment's page, Markdown."""


def columns(problem: SearchProblem) -> list[str]:
    """Return the columns of the experiment's page; the first objective orders the trials."""
    objectives = [objective.name for objective in problem.file.search.objective]
    violations = [f"violation.{limit.name}" for limit in problem.criteria.constraints]
    metrics = [f"metrics.{name}" for name in (*objectives, "feasible", *violations)]
    return [*metrics, "metrics.seconds"]


def ended_trials(study: optuna.Study, problem: SearchProblem) -> Iterator[EndedTrial]:
    """Yield all trials with an assessment."""
    for trial in finished_trials(study):
        describe = partial(_trial_run, trial, problem)
        yield EndedTrial(str(trial.number), describe, trial.user_attrs.get("failure"))


def _trial_run(trial: FrozenTrial, problem: SearchProblem) -> TrialRun:
    objectives = problem.file.search.objective
    assessment, rig = assessment_of(trial), problem.space.rig(trial.params)
    values = trial.values or [math.nan] * len(objectives)
    metrics = {o.name: v for o, v in zip(objectives, values, strict=True)}
    metrics |= {f"violation.{name}": v for name, v in assessment.violations.items()}
    params = {
        name: number(value) if isinstance(value, float) else value
        for name, value in rig_columns(rig).items()
    }
    assert trial.datetime_complete is not None
    return TrialRun(
        f"trial {trial.number}",
        params | {"state": trial.state.name},
        metrics | {"seconds": assessment.seconds, "feasible": float(assessment.feasible)},
        ended=round(1000 * trial.datetime_complete.timestamp()),
    )
