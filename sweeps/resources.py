"""What tasks ask of a machine: a training's memory is seen in one step of it, not guessed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from sweeps.store import AnyStore
from sweeps.task import Task

_TRAININGS = ("finetune", "pretrain")
_MARGIN = 1.25
"""A training's frames differ from step to step; this much more than the probe's is asked for."""


@dataclass(frozen=True)
class Need:
    """What a task asks for, besides one CPU.

    Attributes:
        memory: bytes; 0 if unknown.
        gpu_share: of one GPU.
        batch_size: frames of a step where the settings leave it open; None if unknown.
    """

    memory: int = 0
    gpu_share: float = 0.0
    batch_size: int | None = None


def probes_of(tasks: Iterable[Task]) -> dict[str, Task]:
    """For every training the probe that tells its needs, by the training's key.

    Trainings that differ in placement and seed alone need the same: the first one's clouds are
    tried.
    """
    probes: dict[tuple[str, str], Task] = {}
    found = {}
    for task in tasks:
        if task.stage in _TRAININGS:
            detector, training = task.params["detector"], task.params["training"]
            kind = (detector, repr(training))
            probe = probes.setdefault(
                kind, Task("probe", detector, dict(task.params), task.inputs, gpu=True)
            )
            found[task.key] = probe
    return found


def need_of(
    task: Task, probe: Task | None, store: AnyStore, gpus_per_training: float | Literal["auto"]
) -> Need:
    """What a task asks for, by what its probe found. A failed probe tells nothing."""
    share = 1.0 if gpus_per_training == "auto" else gpus_per_training
    if probe is None or not store.has(probe):
        return Need(gpu_share=share if task.gpu else 0.0)
    found = store.load(probe, ("batch_size", "gpu_share"))
    if gpus_per_training == "auto" and found["gpu_share"] is not None:
        share = rounded_share(found["gpu_share"] * _MARGIN)
    memory = int(store.record(probe)["peak_memory"] * _MARGIN)
    return Need(memory, share, found["batch_size"])


def rounded_share(share: float) -> float:
    """The next larger 1/n, so that n trainings fill a GPU; a whole GPU beyond a half."""
    return 1 / max(1, math.floor(1 / share)) if share > 0 else 0.01
