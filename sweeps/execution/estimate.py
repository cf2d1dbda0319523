"""What a sweep will take: a task of every kind is tried on a few frames, where it will run."""

import math
import shutil
import tempfile
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from sweeps.execution.backends import Backend
from sweeps.execution.needs import Need
from sweeps.execution.worker import Batch, peak_memory, reset_peak_memory, run_task
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.store.local import Store
from sweeps.store.result_folder import Ran
from sweeps.tasks.parameters import CollectParams, RecordedParams
from sweeps.tasks.stages import scene
from sweeps.tasks.task import Task, with_inputs

FRAMES = 16
"""Of each split of a part that a task is tried on; a few steps of a training."""

_WARM_UP = 4
"""Frames of a first try, in which code is loaded and compiled."""

_ROWS_A_FRAME = ("ground_truth", "collect", "evaluate")
"""Stages whose results grow with the frames. Those of others are POGs, weights, few numbers."""

_UNTRIED = ("command", "measure")
"""Stages of programs of others, which may not take so few frames."""

_COPIES = 4
"""Most tries at a time: they share caches and memory as tasks will."""


@dataclass(frozen=True)
class StageEstimate:
    """What the tasks of a stage take that are to be done.

    Attributes:
        seconds: of all of them, one after the other; None: of commands of which none has run.
        bytes: that their results have on disk.
    """

    seconds: float | None
    bytes: float


@dataclass(frozen=True)
class Estimate:
    """What a sweep takes.

    Attributes:
        stages: by name; those of which something is to be done.
        seconds: from the start to the report, without these.
        at_once: tasks that run at a time.
        task_memory: most bytes that a task held on its few frames.
        bytes: of all results to come.
        free_bytes: of the disk on which they will lie.
    """

    stages: Mapping[str, StageEstimate]
    seconds: float
    at_once: int
    task_memory: float
    bytes: float
    free_bytes: float


@dataclass(frozen=True)
class _Tried:
    """A task that was tried: what it took, and on how much, see `_size`."""

    seconds: float
    bytes: float
    memory: float
    size: float


def estimate(
    trials: Sequence[Trial],
    tasks: Sequence[Task],
    cached: Collection[str],
    backend: Backend,
    folder: Path,
    command: float | None = None,
) -> Estimate:
    """Try a task of every kind, and count how often it is to be done.

    Kinds are stages, those with a network by detector; the first trial's rig stands for all.

    Args:
        trials: of the sweep.
        tasks: all that it may run, each after its inputs.
        cached: keys of those that are done.
        backend: where they will run.
        folder: in which results will lie.
        command: seconds of a command, which is not tried; None if unknown.

    Raises:
        ValueError, OSError: what a task itself raised.
    """
    to_do = [task for task in tasks if task.key not in cached]
    kinds = {_kind(task) for task in to_do if task.stage not in _UNTRIED}
    chosen: list[Task] = []
    for trial in trials:
        fresh = kinds - {_kind(task) for task in chosen}
        if not fresh:
            break
        chosen += [task for task in with_inputs(_in_small(trial)) if _kind(task) in fresh]
    gpus = backend.room.gpus if math.isfinite(backend.room.gpus) else 0
    need = Need(gpu_share=1.0) if gpus else Need()
    copies = 1 if gpus else min(backend.cores, _COPIES)
    jobs = [backend.submit(try_tasks, with_inputs(chosen), need=need) for _ in range(copies)]
    found = [job.result() for job in jobs]
    tried, counts = _mean([own for own, _, _ in found]), found[0][1]
    seconds, sizes = dict[str, float](), dict[str, float]()
    for task in to_do:
        if task.stage in _UNTRIED:
            seconds[task.key] = (command or 0.0) if task.stage == "command" else 0.0
            sizes[task.key] = 0.0
            continue
        own = tried[_kind(task)]
        times = _size(task, counts) / own.size
        seconds[task.key] = own.seconds * times
        sizes[task.key] = own.bytes * (times if task.stage in _ROWS_A_FRAME else 1.0)
    stages = {
        stage: StageEstimate(
            None
            if stage == "command" and command is None
            else sum(seconds[task.key] for task in to_do if task.stage == stage),
            sum(sizes[task.key] for task in to_do if task.stage == stage),
        )
        for stage in dict.fromkeys(task.stage for task in to_do)
    }
    on_gpu = sum(seconds[task.key] for task in to_do if task.gpu)
    least = max(
        sum(seconds.values()) / backend.cores,
        on_gpu / gpus if gpus else 0.0,
        _longest_chain(to_do, seconds),
    )
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return Estimate(
        stages,
        least + (max(start for _, _, start in found) if to_do else 0.0),
        backend.cores,
        max((tried[kind].memory for kind in kinds), default=0.0),
        sum(sizes.values()),
        shutil.disk_usage(existing).free,
    )


def try_tasks(
    tasks: Sequence[Task],
) -> tuple[dict[tuple[str, str], _Tried], dict[str, float], float]:
    """Run tasks on a few frames, in a store that is thrown away.

    Returns:
        What each kind took, frames of a part of a scene by split, and the seconds that the first
        try took for loading and compiling.
    """
    start = time.perf_counter()
    _try(tasks, _WARM_UP)
    between = time.perf_counter()
    tried, counts = _try(tasks, FRAMES)
    first, second = between - start, time.perf_counter() - between
    return tried, counts, max(0.0, first - second)


def _try(
    tasks: Sequence[Task], frames: int
) -> tuple[dict[tuple[str, str], _Tried], dict[str, float]]:
    tried: dict[tuple[str, str], _Tried] = {}
    counts: dict[str, float] = {}
    few: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="lidarplace-") as temporary:
        store = Store(Path(temporary))
        for task in tasks:
            if task.stage == "scene":
                reset_peak_memory()
                start = time.perf_counter()
                value = scene(task.params)
                seconds = time.perf_counter() - start
                own, cut = _counts(value), _cut(value, frames)
                counts |= own
                few |= _counts(cut)
                store.save(task, cut, seconds, Ran(peak_memory=peak_memory()))
                share = sum(own.values()) / max(1.0, sum(_counts(cut).values()))
                took = _took(task, store, 1.0, share)
            else:
                run_task(task, store, Batch())
                took = _took(task, store, _size(task, few), 1.0)
            tried.setdefault(_kind(task), took)
    return tried, counts


def _took(task: Task, store: Store, size: float, share: float) -> _Tried:
    """Of a result: its files may hold but a `share`-th of what they will."""
    record = store.record(task)
    written = sum(path.stat().st_size for path in store.path(task).iterdir())
    return _Tried(record.seconds, share * written, float(record.peak_memory), size)


def _counts(log: BoxLog) -> dict[str, float]:
    """Frames of a log by split."""
    found = log.frames["split"].value_counts()
    return {str(split): float(count) for split, count in found.items()}


def _cut(log: BoxLog, frames: int) -> BoxLog:
    """A log of so many frames of each split, spread over those with an object."""
    table, boxes = log.frames, log.boxes
    full = table[table["frame"].isin(boxes["frame"])]
    kept = []
    for _, own in (full if len(full) else table).groupby("split"):
        kept.append(own.iloc[np.unique(np.linspace(0, len(own) - 1, frames).astype(int))])
    few = pd.concat(kept).sort_index()
    return replace(log, frames=few, boxes=boxes[boxes["frame"].isin(few["frame"])])


def _in_small(trial: Trial) -> list[Task]:
    """A trial's tasks for one part of its scene with training frames, and one with test frames;
    of trainings a single epoch."""
    tests = trial.collect_test[:1] if isinstance(trial, DetectorTrial) else ()
    scenes = {trial.scenes[0].key, *(task.key for test in tests for task in test.inputs)}
    made: dict[str, Task | None] = {}

    def small(task: Task) -> Task | None:
        if task.key not in made:
            inputs = tuple(filter(None, map(small, task.inputs)))
            other = task.stage == "scene" and task.key not in scenes
            gone = other or bool(task.inputs and not inputs)
            made[task.key] = None if gone else replace(task, inputs=inputs, params=_brief(task))
        return made[task.key]

    return list(filter(None, map(small, trial.results)))


def _brief(task: Task) -> Any:
    """Parameters of a task; those of a training for one epoch."""
    if not task.resumable:
        return task.params
    return replace(task.params, training=task.params.training.model_copy(update={"epochs": 1}))


def _kind(task: Task) -> tuple[str, str]:
    """What tasks have in common that take as long on the same frames."""
    return task.stage, getattr(task.params, "detector", "")


def _size(task: Task, frames: Mapping[str, float]) -> float:
    """What a task's time is proportional to, for `frames` of a part of a scene by split.

    Frames of clouds, for trainings times epochs; 1 where frames make little difference.
    """
    params = task.params
    if isinstance(params, CollectParams):
        return frames[params.split] / params.every
    if isinstance(params, RecordedParams):
        return frames[params.split]
    if task.stage == "ground_truth":
        return sum(frames.values())
    if task.stage in ("pretrain", "finetune", "evaluate"):
        clouds = sum(_size(own, frames) for own in task.inputs if own.stage == "collect")
        return clouds * (params.training.epochs if task.resumable else 1)
    return 1.0


def _mean(tries: Sequence[Mapping[tuple[str, str], _Tried]]) -> dict[tuple[str, str], _Tried]:
    """Of tries side by side: mean seconds, most memory."""
    return {
        kind: replace(
            own,
            seconds=sum(tried[kind].seconds for tried in tries) / len(tries),
            memory=max(tried[kind].memory for tried in tries),
        )
        for kind, own in tries[0].items()
    }


def _longest_chain(tasks: Iterable[Task], seconds: Mapping[str, float]) -> float:
    """Seconds of the tasks that have to wait for each other, where these are most."""
    ends: dict[str, float] = {}
    for task in tasks:  # each after its inputs
        before = max((ends.get(own.key, 0.0) for own in task.inputs), default=0.0)
        ends[task.key] = before + seconds[task.key]
    return max(ends.values(), default=0.0)
