"""How well the tasks of a sweep kept its cores at work."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

WHOLE_SWEEP = "whole sweep"
"""The last row of `stage_efficiency`."""

_COLUMNS = ("stage", "tasks", "task_seconds", "wall", "efficiency", "overhead", "peak_memory")


def stage_efficiency(tasks: pd.DataFrame, cores: int) -> pd.DataFrame:
    """Parallel efficiency of every stage: task seconds / (wall seconds × cores).

    Stages run side by side, so they share the clock: while k tasks run, k_s of them of stage s,
    that stage is charged k_s / k of the time. A stage that runs alone is charged all of it, and
    the stages together are charged the time in which anything ran. Exact but for rounding: the
    counts change at the start and the end of a task only.

    Args:
        tasks: stage; seconds, of the task's own work; started and ended, seconds since the start
            of the sweep, NaN for a task that did not run in it; peak_memory, bytes or NaN.
        cores: tasks that could run at once, over all nodes.

    Returns:
        One row a stage in the order of `tasks`: stage, tasks (that ran), task_seconds, wall
        (seconds), efficiency, overhead (mean over tasks of the seconds from start to end beyond
        the task's own) and peak_memory (bytes, the largest). The last row is WHOLE_SWEEP: its wall
        goes from the start of the sweep to the end of the last task, idle time included. Empty if
        no task ran.

    Raises:
        ValueError: `cores` is less than 1, or a task ended before it started.
    """
    if cores < 1:
        raise ValueError(f"cores must be at least 1, found {cores}")
    ran = tasks[tasks["started"].notna() & tasks["ended"].notna()]
    if ran.empty:
        return pd.DataFrame(columns=_COLUMNS)
    backwards = ran[ran["ended"] < ran["started"]]
    if len(backwards):
        row = backwards.iloc[0]
        raise ValueError(
            f"a task of stage {row['stage']} started at {row['started']} s and ended at "
            f"{row['ended']} s"
        )
    stage, names = pd.factorize(ran["stage"])
    wall = _charged(stage, ran["started"].to_numpy(), ran["ended"].to_numpy())
    rows = [_row(name, ran[stage == i], wall[i], cores) for i, name in enumerate(names)]
    rows.append(_row(WHOLE_SWEEP, ran, ran["ended"].max(), cores))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _charged(
    stage: NDArray[np.int64], started: NDArray[np.float64], ended: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Seconds of the clock charged to each stage.

    Args:
        stage: number of the stage of each task, shape (tasks,).
        started, ended: seconds, shape (tasks,).
    """
    own = stage[:, None] == np.arange(stage.max() + 1)
    change = np.concatenate([own.astype(np.int64), -own.astype(np.int64)])
    moment = np.concatenate([started, ended])
    order = np.argsort(moment, kind="stable")
    running = np.cumsum(change[order], axis=0)[:-1]
    share = running / np.maximum(running.sum(axis=1, keepdims=True), 1)
    return np.asarray(np.diff(moment[order]) @ share)


def _row(stage: object, part: pd.DataFrame, wall: float, cores: int) -> tuple[object, ...]:
    spent = part["seconds"].sum()
    overhead = (part["ended"] - part["started"] - part["seconds"]).mean()
    efficiency = spent / (wall * cores) if wall > 0 else np.nan
    return (stage, len(part), spent, wall, efficiency, overhead, part["peak_memory"].max())
