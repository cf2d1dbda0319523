"""The section about run time: seconds by stage, and parallel efficiency."""

import pandas as pd

from tracking.labels import digits, some
from tracking.pages.section import Section, Table, numbers, words
from tracking.report.analysis import Analysis

_COLUMNS = ("stage", "tasks", "task_seconds", "wall", "overhead", "peak_memory")


def where_time_went(found: Analysis) -> Section:
    """Task seconds of every stage, and how well the cores were kept at work."""
    run = found.run
    section = Section("Where the time went")
    if run.tasks is None or run.tasks.empty:
        section.notes.append("The run folder has no tasks.parquet.")
        return section
    if run.sweep.seconds is not None:
        section.notes.append(_last_command(run.sweep.seconds, run.tasks))
    if run.tasks["started"].isna().all():
        section.notes.append("No task ran, so no efficiency.")
        return section
    if run.sweep.cores is None:
        section.notes.append("The run folder does not say how many cores it had: no efficiency.")
        return section
    table = stage_times(run.tasks)
    section.notes += _sentences(run.tasks, run.sweep.cores)
    section.tables.append(times_table(table))
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


def times_table(times: pd.DataFrame) -> Table:
    """`stage_times` as text."""
    columns = [
        words("stage"),
        numbers("tasks", "tasks", ","),
        numbers("task seconds", "task_seconds", ",.1f"),
        numbers("wall seconds", "wall", ",.1f"),
        numbers("overhead a task (ms)", "overhead", _milliseconds),
        numbers("peak memory (MB)", "peak_memory", lambda size: digits(size / 1e6, ",.0f")),
    ]
    return Table.of(
        "Seconds by stage",
        times,
        columns,
        name="stages",
        units={"task_seconds": "s", "wall": "s", "overhead": "s", "peak_memory": "bytes"},
    )


def _milliseconds(seconds: float) -> str:
    return digits(1000 * seconds, ",.1f")


def stage_times(tasks: pd.DataFrame) -> pd.DataFrame:
    """Seconds of every stage.

    Args:
        tasks: stage; seconds, of the task's own work; started and ended, seconds since the start
            of the sweep, NaN for a task that did not run in it; peak_memory, bytes or NaN.

    Returns:
        One row a stage in the order of `tasks`: stage, tasks (that ran), task_seconds, wall
        (seconds from its first start to its last end), overhead (mean over tasks of the seconds
        from start to end beyond the task's own) and peak_memory (bytes, the largest). Empty if no
        task ran.
    """
    rows = [
        (
            stage,
            len(own),
            own["seconds"].sum(),
            own["ended"].max() - own["started"].min(),
            (own["ended"] - own["started"] - own["seconds"]).mean(),
            own["peak_memory"].max(),
        )
        for stage, own in tasks[tasks["started"].notna()].groupby("stage", sort=False)
    ]
    return pd.DataFrame(rows, columns=_COLUMNS)
