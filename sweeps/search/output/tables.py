"""The tables of a search, with units in the names of their columns, and what mattered."""

import math
import warnings
from collections.abc import Sequence
from typing import Any

import optuna
import pandas as pd
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

from sweeps.results.trial_results import cells
from sweeps.search.problem.choice import Choice, Choices
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import assessment_of, candidate_of, finished_trials


def mount_columns(lidar: Choice) -> dict[str, Any]:
    """A LiDAR in metres and degrees."""
    mount = lidar.mount
    angles = {f"{n}_deg": math.degrees(getattr(mount, n)) for n in ("roll", "pitch", "yaw")}
    place = {"x_m": mount.x, "y_m": mount.y, "z_m": mount.z}
    return {"model": lidar.model, "zone": lidar.zone} | place | angles


def rig_columns(rig: Choices) -> dict[str, Any]:
    """All LiDARs of a rig: `lidar_1.model`, `lidar_1.x_m`, ..."""
    return {
        f"lidar_{i}.{name}": value
        for i, lidar in enumerate(rig, start=1)
        for name, value in mount_columns(lidar).items()
    }


def trials_table(study: optuna.Study, problem: Problem) -> pd.DataFrame:
    """A row a trial: number, state, feasible, objectives, violations, seconds and the rig."""
    objectives = problem.file.search.objective
    rows = []
    for trial in finished_trials(study):
        found, candidate = assessment_of(trial), candidate_of(trial, problem.space)
        values = trial.values or [math.nan] * len(objectives)
        rows.append(
            {"number": trial.number, "state": trial.state.name, "feasible": found.feasible}
            | {"possible": found.values is not None}
            | {f"value.{o.name}": v for o, v in zip(objectives, values, strict=True)}
            | {f"violation.{name}": v for name, v in found.violations.items()}
            | {name: v for name, v in found.measures.items() if name.startswith("enough.")}
            | {"seconds": found.seconds, "failure": trial.user_attrs.get("failure", "")}
            | {f"param.{key}": value for key, value in cells(candidate.values).items()}
            | {"lidars": len(candidate.rig)}
            | rig_columns(candidate.rig)
        )
    return pd.DataFrame(rows)


def greedy_table(rigs: Sequence[Choices], gains: Sequence[float], start: float) -> pd.DataFrame:
    """A row a step of greedy choice: step, gain, value, and what was added."""
    rows = []
    value = start
    for step, (rig, gain) in enumerate(zip(rigs, gains, strict=True), start=1):
        value += gain
        rows.append({"step": step, "gain": gain, "value": value} | rig_columns(rig))
    return pd.DataFrame(rows)


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
