"""Dry run of a sweep: tasks by stage, cached ones, frames, rungs and trials."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.filesize import decimal
from rich.table import Table as RichTable

from lidarplace.command_line.terminal import table
from lidarplace.requirements.tables import extents
from sweeps.configuration.grid import Sweep
from sweeps.execution.memory import machine_memory
from sweeps.plan.trial import Plan
from sweeps.results.promotion import at_most
from sweeps.results.rig_cautions import rig_cautions
from sweeps.store.local import Store
from training.typical_objects import as_plain, from_plain


@dataclass(frozen=True)
class DryRun:
    """Tasks of a sweep that would run.

    Attributes:
        name: of the sweep.
        stages: tasks, and how many of them are cached, by stage; at most these with `promote`.
        rungs: by, keep, set.
        scenes: scene, train_frames, test_frames.
        trials: key, label, cached, in the order of the grid.
        requirements: what each asks of every placement: `lidarplace.requirements.tables.extents`.
        anchors: sizes that detectors start from, of classes that the preset does not define.
        memory: most bytes that the voxels of a task take.
        cautions: about the classes and the rigs."""

    name: str
    stages: dict[str, dict[str, int]]
    rungs: list[dict[str, Any]]
    scenes: list[dict[str, Any]]
    trials: list[dict[str, Any]]
    requirements: list[dict[str, str | int]]
    anchors: list[dict[str, object]]
    memory: int
    cautions: list[str]


def describe_dry_run(sweep: Sweep, plan: Plan, store: Store) -> DryRun:
    """Count the tasks of a plan, and those that have a result."""
    cached = store.finished(plan.tasks)
    tasks = at_most(sweep, plan)
    total = Counter(task.stage.name for task in tasks)
    finished = Counter(task.stage.name for task in tasks if task.key in cached)
    frames = {t.scene_label: t.grid_point.point.frame_counts() for t in plan.trials}
    counts = ("train_frames", "test_frames")
    return DryRun(
        name=sweep.common.name,
        stages={s: {"tasks": count, "cached": finished[s]} for s, count in total.items()},
        rungs=[
            rung.model_dump(mode="json", include={"by", "keep", "set"})
            for rung in sweep.common.promote
        ],
        scenes=[
            {"scene": label, **dict(zip(counts, t, strict=True))} for label, t in frames.items()
        ],
        trials=[
            {"key": t.key, "label": t.label, "cached": {t.key for t in t.results} <= cached}
            for t in plan.trials
        ],
        requirements=extents(plan.layouts),
        anchors=as_plain(plan.typical),
        memory=max(task.stage.need().memory for task in tasks),
        cautions=[*plan.cautions, *rig_cautions(plan)],
    )


def extent_table(requirements: Sequence[dict[str, str | int]]) -> RichTable:
    """Show what requirements ask of a rig, for a terminal; rows of `extents`."""
    rows = (extent.values() for extent in requirements)
    return table(None, tuple(requirements[0]), rows, words={"measure"})


def print_dry_run(console: Console, planned: DryRun) -> None:
    """Print the plan of a sweep."""
    title = f"{planned.name}: {len(planned.trials)} trials"
    if planned.rungs:
        title += "; of these at most the tasks that promotion leaves"
    rows = (
        (stage, row["tasks"], row["cached"], row["tasks"] - row["cached"])
        for stage, row in planned.stages.items()
    )
    console.print(table(title, ("stage", "tasks", "cached", "to do"), rows))
    for number, rung in enumerate(planned.rungs):
        changed = ", ".join(f"{key}={value}" for key, value in rung["set"].items())
        by = f"{rung['by']}{f' with {changed}' if changed else ''}"
        console.print(f"rung {number}: {by}, the best {rung['keep']} placements are kept")
    for row in planned.scenes:
        frames = f"{row['train_frames']} frames to train, {row['test_frames']} to test"
        console.print(f"scene {row['scene']}: {frames}")
    total, free = map(decimal, machine_memory())
    needed = f"memory: the voxels of a task take up to {decimal(planned.memory)}"
    console.print(f"{needed}; this machine has {total}, {free} of it free", soft_wrap=True)
    if planned.requirements:
        console.print(extent_table(planned.requirements))
    for typical in from_plain({"typical": planned.anchors}):
        console.print(f"anchors of {typical}")
    for trial in planned.trials:
        cached = "  (cached)" if trial["cached"] else ""
        console.print(f"trial {trial['key']}  {trial['label']}{cached}")
    for caution in planned.cautions:
        console.print(f"warning: {caution}", style="yellow", soft_wrap=True)
