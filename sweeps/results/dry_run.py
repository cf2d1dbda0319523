"""What `--dry-run` shows: tasks by stage, what is there already, frames, rungs and trials."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from lidarplace.command_line.terminal import table
from sweeps.configuration.grid import Sweep
from sweeps.plan.plan import Plan
from sweeps.results.promotion import at_most
from sweeps.results.rig_cautions import rig_cautions
from sweeps.store.open import AnyStore
from training.typical_objects import as_plain, from_plain


@dataclass(frozen=True)
class Planned:
    """What a sweep would do.

    Attributes:
        name: of the sweep.
        stages: tasks, and how many of them are cached, by stage; with `promote` at most so many.
        rungs: by, keep and set of each.
        scenes: scene, and its frames of each split.
        trials: key, label and whether it is cached, in the order of the grid.
        anchors: sizes that detectors start from, of classes that have not the preset's.
        cautions: what is to be known of the classes and of the rigs.
    """

    name: str
    stages: dict[str, dict[str, int]]
    rungs: list[dict[str, Any]]
    scenes: list[dict[str, Any]]
    trials: list[dict[str, Any]]
    anchors: list[dict[str, Any]]
    cautions: list[str]


def planned(sweep: Sweep, plan: Plan, store: AnyStore) -> Planned:
    """Look at what is there, and count what is not."""
    cached = store.finished(plan.tasks)
    tasks = at_most(sweep, plan)
    total = Counter(task.stage for task in tasks)
    there = Counter(task.stage for task in tasks if task.key in cached)
    frames = {t.scene_label: t.grid_point.point.scene.frame_counts() for t in plan.trials}
    return Planned(
        name=sweep.common.name,
        stages={s: {"tasks": count, "cached": there[s]} for s, count in total.items()},
        rungs=[
            rung.model_dump(mode="json", include={"by", "keep", "set"})
            for rung in sweep.common.promote
        ],
        scenes=[
            {"scene": label, "train_frames": train, "test_frames": test}
            for label, (train, test) in frames.items()
        ],
        trials=[
            {
                "key": trial.key,
                "label": trial.label,
                "cached": all(task.key in cached for task in trial.results),
            }
            for trial in plan.trials
        ],
        anchors=as_plain(plan.typical),
        cautions=[*plan.cautions, *rig_cautions(plan, store)],
    )


def print_planned(console: Console, shown: Planned) -> None:
    """Print the plan of a sweep."""
    title = f"{shown.name}: {len(shown.trials)} trials"
    if shown.rungs:
        title += "; of these at most the tasks that promotion leaves"
    rows = (
        (stage, own["tasks"], own["cached"], own["tasks"] - own["cached"])
        for stage, own in shown.stages.items()
    )
    console.print(table(title, ("stage", "tasks", "cached", "to do"), rows))
    for number, rung in enumerate(shown.rungs):
        changed = ", ".join(f"{key}={value}" for key, value in rung["set"].items())
        console.print(
            f"rung {number}: {rung['by']}{f' with {changed}' if changed else ''}, the best "
            f"{rung['keep']} placements go on"
        )
    for scene in shown.scenes:
        console.print(
            f"scene {scene['scene']}: {scene['train_frames']} frames to train, "
            f"{scene['test_frames']} to test"
        )
    for typical in from_plain({"typical": shown.anchors}):
        console.print(f"anchors of {typical}")
    for trial in shown.trials:
        cached = "  (cached)" if trial["cached"] else ""
        console.print(f"trial {trial['key']}  {trial['label']}{cached}")
    for caution in shown.cautions:
        console.print(f"warning: {caution}", style="yellow", soft_wrap=True)
