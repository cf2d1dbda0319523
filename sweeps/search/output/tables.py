"""The tables of a search, with units in the names of their columns."""

import math
from collections.abc import Sequence
from typing import Any

import optuna
import pandas as pd

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
