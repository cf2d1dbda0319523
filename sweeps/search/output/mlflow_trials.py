"""A run at MLflow for every trial of a search."""

from __future__ import annotations

import math

import optuna

from sweeps.search.output.tables import rig_columns
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import assessment_of, candidate_of, finished_trials
from tracking.mlflow.log import SweepLog


class TrialRuns:
    """Hands finished trials to MLflow, which gets them in the background."""

    def __init__(self, log: SweepLog, study: optuna.Study, problem: Problem) -> None:
        self._log, self._study, self._problem = log, study, problem
        self._logged = 0

    def log_new(self) -> None:
        """Log what was finished since the last call; at the first one, all."""
        objectives = self._problem.file.search.objective
        for trial in finished_trials(self._study):
            if trial.number < self._logged:
                continue
            self._logged = trial.number + 1
            found, candidate = assessment_of(trial), candidate_of(trial, self._problem.space)
            values = trial.values or [math.nan] * len(objectives)
            metrics = {o.name: v for o, v in zip(objectives, values, strict=True)}
            metrics |= {f"violation.{name}": v for name, v in found.violations.items()}
            params = {
                name: f"{value:.6g}" if isinstance(value, float) else value
                for name, value in rig_columns(candidate.rig).items()
            }
            self._log.trial(
                str(trial.number),
                f"trial {trial.number}",
                params | dict(candidate.values) | {"state": trial.state.name},
                metrics | {"seconds": found.seconds, "feasible": float(found.feasible)},
                error=trial.user_attrs.get("failure"),
            )
