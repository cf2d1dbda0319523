"""The section about run time: seconds by stage and parallel efficiency."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from tracking.figures.kit.style import colour, figure, text
from tracking.labels import digits, some
from tracking.pages.section import Section, Table, numbers, words
from tracking.report.analysis import Analysis

WHOLE_SWEEP = "whole sweep"
"""The last row of `stage_efficiency`."""
_COLUMNS = ("stage", "tasks", "task_seconds", "wall", "efficiency", "overhead", "peak_memory")


def where_time_went(found: Analysis) -> Section:
    """Task seconds of every stage, and how well the cores were kept at work."""
    run = found.run
    section = Section("Where the time went", columns=1, folded=True)
    if run.tasks is None or run.tasks.empty:
        section.notes.append("The run folder has no tasks.parquet.")
        return section
    if run.sweep.seconds is not None:
        section.notes.append(_last_command(run.sweep.seconds, run.tasks))
    section.figures.append(times(run.tasks))
    if run.tasks["started"].isna().all():
        section.notes.append("No task ran, so no efficiency.")
        return section
    if run.sweep.cores is None:
        section.notes.append("The run folder does not say how many cores it had: no efficiency.")
        return section
    cores = run.sweep.cores
    efficiency = stage_efficiency(run.tasks, cores)
    section.notes += _sentences(efficiency, cores, run.tasks)
    section.tables.append(efficiency_table(efficiency, cores))
    return section


def _last_command(seconds: float, tasks: pd.DataFrame) -> str:
    """Seconds on the clock, which are not those of the sweep if it was resumed or run again."""
    said = f"The last command took {seconds:,.0f} s on the clock."
    before = int(tasks["cached"].sum())
    if not before:
        return said
    return (
        f"{said} It found {before:,} of the {len(tasks):,} results in place, so this is "
        "not the time of the whole sweep."
    )


def _sentences(efficiency: pd.DataFrame, cores: int, tasks: pd.DataFrame) -> list[str]:
    whole = efficiency[efficiency["stage"] == WHOLE_SWEEP].iloc[0]
    stages = efficiency[efficiency["stage"] != WHOLE_SWEEP]
    idle = whole["wall"] - stages["wall"].sum()
    nodes = tasks.loc[tasks["started"].notna() & (tasks["node"] != ""), "node"].nunique()
    where = f"{cores} cores" + (f" of {nodes} nodes" if nodes > 1 else "")
    costly = stages.sort_values("wall").iloc[-1]
    return [
        f"{whole['tasks']:,} tasks did {whole['task_seconds']:,.0f} s of work on {where} in "
        f"{whole['wall']:,.0f} s: parallel efficiency {whole['efficiency']:.2f}. Nothing ran for "
        f"{idle:,.1f} s of these. Most of the clock went to {costly['stage']}, at an efficiency of "
        f"{costly['efficiency']:.2f}.",
        "Parallel efficiency is task seconds / (wall seconds × cores). Stages that run side by "
        "side share the clock by the number of their tasks. Overhead is the time of a task from "
        "start to end beyond its own work: fetching inputs, storing results.",
    ]


def reduced_batches(tasks: pd.DataFrame | None) -> list[str]:
    """A warning if trainings ran out of memory and went on with smaller batches."""
    if tasks is None or not tasks["batch_size_reduced"].any():
        return []
    labels = tasks.loc[tasks["batch_size_reduced"].astype(bool), "label"].unique().tolist()
    named = some(labels)
    return [
        f"{len(labels)} training{'s' * (len(labels) > 1)} ran with a smaller batch than "
        f"configured, for lack of memory: {named}. Batch size changes what is learned, so "
        "the comparison with the others is not quite fair."
    ]


def efficiency_table(efficiency: pd.DataFrame, cores: int) -> Table:
    """`tracking.report.sections.where_time_went.stage_efficiency` as text."""
    columns = [
        words("stage"),
        numbers("tasks", "tasks", ","),
        numbers("task seconds", "task_seconds", ",.1f"),
        numbers("wall seconds", "wall", ",.1f"),
        numbers("parallel efficiency", "efficiency", ".2f"),
        numbers("overhead a task (ms)", "overhead", _milliseconds),
        numbers("peak memory (MB)", "peak_memory", lambda size: digits(size / 1e6, ",.0f")),
    ]
    return Table.of(
        f"Parallel efficiency on {cores} cores",
        efficiency,
        columns,
        name="efficiency",
        units={"task_seconds": "s", "wall": "s", "overhead": "s", "peak_memory": "bytes"},
    )


def _milliseconds(seconds: float) -> str:
    return digits(1000 * seconds, ",.1f")


def times(tasks: pd.DataFrame) -> go.Figure:
    """Seconds of all tasks of a stage: spent in this run, and spared by results on disk.

    Args:
        tasks: stage, seconds (what the task took when it ran), cached.
    """
    stages = list(dict.fromkeys(tasks["stage"]))
    plot = figure("Time of all tasks by stage", height=130 + 34 * len(stages))
    for cached, name, shade in (
        (False, "spent in this run", colour(0)),
        (True, "spared: result was on disk", colour(6)),
    ):
        part = tasks[tasks["cached"].astype(bool) == cached].groupby("stage")["seconds"]
        total, count = part.sum(), part.size()
        here = [stage for stage in stages if stage in total.index]
        if not here:
            continue
        plot.add_bar(
            y=[text(stage) for stage in here],
            x=[total[stage] for stage in here],
            orientation="h",
            name=name,
            marker={"color": shade},
            text=[
                f"{total[stage]:,.{0 if total[stage] >= 10 else 2}f} s · {count[stage]} ×"
                for stage in here
            ],
            textposition="auto",
            hovertemplate="%{y}: %{x:,.1f} s<extra>" + name + "</extra>",
        )
    plot.update_layout(barmode="stack", legend={"orientation": "h", "y": -0.35})
    plot.update_xaxes(title="seconds, summed over workers")
    plot.update_yaxes(
        autorange="reversed", categoryorder="array", categoryarray=[text(stage) for stage in stages]
    )
    return plot


def stage_efficiency(tasks: pd.DataFrame, cores: int) -> pd.DataFrame:
    """Parallel efficiency of every stage: task seconds / (wall seconds × cores).

    Stages run side by side, so they share the clock: while k tasks run, k_s of them of stage s,
    that stage is charged k_s / k of the time. A stage that runs alone is charged all of it, and
    the stages together are charged the time in which anything ran. Exact but for rounding: the
    counts change at the start and the end of a task only.

    Args:
        tasks: stage; seconds, of the task's own work; started and ended, seconds since the start
            of the sweep, NaN for a task that did not run in it; peak_memory, bytes or NaN.
        cores: tasks that could run at once, over all nodes, at least 1.

    Returns:
        One row a stage in the order of `tasks`: stage, tasks (that ran), task_seconds, wall
        (seconds), efficiency, overhead (mean over tasks of the seconds from start to end beyond
        the task's own) and peak_memory (bytes, the largest). The last row is WHOLE_SWEEP: its wall
        goes from the start of the sweep to the end of the last task, idle time included. Empty if
        no task ran.

    Raises:
        ValueError: a task ended before it started.
    """
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
