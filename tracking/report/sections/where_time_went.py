"""Run time: seconds by stage, and parallel efficiency."""

import pandas as pd

from tracking.labels import digits, some
from tracking.pages.section import Section, Table, numbers, words
from tracking.report.analysis import Analysis


def where_time_went(analysis: Analysis) -> Section:
    """Show task seconds of every stage, and how well the cores were kept at work."""
    run = analysis.run
    section = Section("Where the time went")
    if run.tasks is None or run.tasks.empty:
        section.notes.append("The run folder has no tasks.parquet.")
        return section
    if run.sweep.seconds is not None:
        before = run.tasks["cached"].sum()
        more = (
            f" It found {before:,} of the {len(run.tasks):,} results in place, so this is not the "
            "time of the whole sweep."
        )
        duration = f"The last command took {run.sweep.seconds:,.0f} s on the clock."
        section.notes.append(duration + (more if before else ""))
    if run.tasks["started"].isna().all():
        section.notes.append("No task ran, so no efficiency.")
        return section
    if run.sweep.cores is None:
        section.notes.append("The run folder does not say how many cores it had: no efficiency.")
        return section
    section.notes += _sentences(run.tasks, run.sweep.cores)
    columns = [
        words("stage"),
        numbers("tasks", "tasks", ","),
        numbers("task seconds", "task_seconds", ",.1f"),
        numbers("wall seconds", "wall", ",.1f"),
        numbers("overhead a task (ms)", "overhead", lambda s: digits(1000 * s, ",.0f")),
        numbers("peak memory (MB)", "peak_memory", lambda size: digits(size / 1e6, ",.0f")),
    ]
    units = dict.fromkeys(("task_seconds", "wall", "overhead"), "s") | {"peak_memory": "bytes"}
    times = stage_times(run.tasks)
    section.tables.append(Table.of("Seconds by stage", times, columns, units, name="stages"))
    return section


def _sentences(tasks: pd.DataFrame, cores: int) -> list[str]:
    ran = tasks[tasks["started"].notna()]
    work, wall = ran["seconds"].sum(), ran["ended"].max()
    nodes = ran.loc[ran["node"] != "", "node"].nunique()
    where = f"{cores} cores" + (f" of {nodes} nodes" if nodes > 1 else "")
    return [
        f"{len(ran):,} tasks did {work:,.0f} s of work on {where} in {wall:,.0f} s: parallel "
        f"efficiency {work / (wall * cores):.2f}, which is task seconds / (wall seconds × cores).",
        "Wall seconds of a stage are from its first start to its last end; stages run side by "
        "side. Overhead is the time of a task from start to end beyond its own work: fetching "
        "inputs, storing results.",
    ]


def reduced_batches(tasks: pd.DataFrame | None) -> list[str]:
    """Warn if trainings ran out of memory and continued with smaller batches."""
    if tasks is None or not tasks["batch_size_reduced"].any():
        return []
    labels = tasks.loc[tasks["batch_size_reduced"].astype(bool), "label"].unique().tolist()
    return [
        f"{len(labels)} training{'s' * (len(labels) > 1)} ran with a smaller batch than "
        f"configured, for lack of memory: {some(labels)}. Batch size changes what is learned, so "
        "the comparison with the others is not quite fair."
    ]


def stage_times(tasks: pd.DataFrame) -> pd.DataFrame:
    """Sum the seconds of every stage in the order of `tasks`, of those tasks that ran.

    Columns stage, tasks, task_seconds, wall (from its first start to its last end), overhead (mean
    over tasks of the seconds beyond the task's own) and peak_memory (bytes, the largest)."""
    rows = []
    for stage, of_stage in tasks[tasks["started"].notna()].groupby("stage", sort=False):
        wall = of_stage["ended"].max() - of_stage["started"].min()
        overhead = (of_stage["ended"] - of_stage["started"] - of_stage["seconds"]).mean()
        spent = (of_stage["seconds"].sum(), wall, overhead)
        rows.append((stage, len(of_stage), *spent, of_stage["peak_memory"].max()))
    columns = ["stage", "tasks", "task_seconds", "wall", "overhead", "peak_memory"]
    return pd.DataFrame(rows, columns=columns)
