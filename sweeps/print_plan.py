"""What `--dry-run` shows: tasks by stage, what is there already, frames, rungs and trials."""

from __future__ import annotations

from collections import Counter

from rich.console import Console
from rich.table import Table

from sweeps.grid import Sweep
from sweeps.plan import Plan
from sweeps.promotion import at_most
from sweeps.store import AnyStore


def print_plan(console: Console, sweep: Sweep, plan: Plan, store: AnyStore) -> None:
    """Print the plan of a sweep."""
    cached = store.finished(plan.tasks)
    tasks = at_most(sweep, plan)
    title = f"{sweep.common.name}: {len(plan.trials)} trials"
    if sweep.common.promote:
        title += "; of these at most the tasks that promotion leaves"
    table = Table(title=title)
    for column in ("stage", "tasks", "cached", "to do"):
        table.add_column(column, justify="left" if column == "stage" else "right")
    total = Counter(task.stage for task in tasks)
    there = Counter(task.stage for task in tasks if task.key in cached)
    for stage, count in total.items():
        table.add_row(stage, str(count), str(there[stage]), str(count - there[stage]))
    console.print(table)
    for number, rung in enumerate(sweep.common.promote):
        changed = ", ".join(f"{key}={value}" for key, value in rung.set.items())
        console.print(
            f"rung {number}: {rung.by}{f' with {changed}' if changed else ''}, the best "
            f"{rung.keep} placements go on"
        )
    scenes = {trial.scene_label: trial.grid_point.point.scene for trial in plan.trials}
    for label, scene in scenes.items():
        train, test = scene.frame_counts()
        console.print(f"scene {label}: {train} frames to train, {test} to test")
    for trial in plan.trials:
        done = all(task.key in cached for task in trial.results)
        console.print(f"trial {trial.key}  {trial.label}{'  (cached)' if done else ''}")
