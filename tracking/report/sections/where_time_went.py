"""The section about run time: seconds by stage and parallel efficiency."""

from __future__ import annotations

import pandas as pd

from tracking.figures.of_sweeps.times import times
from tracking.findings.efficiency import WHOLE_SWEEP, stage_efficiency
from tracking.labels import some
from tracking.numbers import digits
from tracking.pages.section import Section
from tracking.pages.tables import Table, numbers, words
from tracking.run_folders.sweep import RunFolder


def where_time_went(run: RunFolder) -> Section:
    """Task seconds of every stage, and how well the cores were kept at work."""
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
        "side share the clock by the number of their tasks. Overhead is what a task took from "
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
    """`tracking.findings.efficiency.stage_efficiency` as text."""
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
