"""What tasks ask of a machine: a training's memory is seen in one step of it, not guessed."""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from sweeps.execution.memory import voxel_memory
from sweeps.store.open import AnyStore
from sweeps.tasks.parameters import CollectParams, CommandParams, ProbeParams, RecordedParams
from sweeps.tasks.results import Probed
from sweeps.tasks.task import Task, plain

_MARGIN = 1.25
"""A training's frames differ from step to step; this much more than the probe's is asked for."""


@dataclass(frozen=True)
class Need:
    """What a task asks for.

    Attributes:
        memory: bytes; 0 if unknown.
        gpu_share: of one GPU; more of a command.
        batch_size: frames of a step where the settings leave it open; None if unknown.
    """

    memory: int = 0
    gpu_share: float = 0.0
    batch_size: int | None = None
    cpus: int = 1


def is_training(task: Task) -> bool:
    """Whether a probe measures the needs of a task."""
    return task.stage in ("finetune", "pretrain")


def probes_of(tasks: Iterable[Task], device: str, gpu_share: float) -> dict[str, Task[Probed]]:
    """For every training the probe that measures its needs, by the training's key.

    Trainings that differ in placement and seed alone need the same: the first one's clouds are
    tried.

    Args:
        tasks: all of a sweep, also those that are done: a resumed sweep has the same probes.
        device: what trainings run on; measurements on another do not apply.
        gpu_share: of a GPU's memory that a training may take.
    """
    probes: dict[str, Task[Probed]] = {}
    found = {}
    for task in tasks:
        if is_training(task):
            own = {k: v for k, v in vars(task.params).items() if k != "seed"}
            params = ProbeParams(**own, device=device, gpu_share=gpu_share)
            probe: Task[Probed] = Task("probe", params.detector, params, task.inputs, gpu=True)
            found[task.key] = probes.setdefault(_kind(probe), probe)
    return found


def _kind(probe: Task) -> str:
    """What trainings of the same needs have in common: all but the seed and where LiDARs are."""
    clouds = [
        (_without_place(item.params), scene.key) for item in probe.inputs for scene in item.inputs
    ]
    return json.dumps([probe.params, clouds], sort_keys=True, default=plain)


def _without_place(params: Any) -> Any:
    """Parameters of a collection without what differs between placements of the same LiDARs."""
    match params:
        case CollectParams():
            return params.placement.lidars, params.misaligned_heights, params.seed, params.split
        case RecordedParams():
            return params.split
    return params


def need_of(
    task: Task,
    probe: Task[Probed] | None,
    store: AnyStore,
    gpus_per_training: float | Literal["auto"],
) -> Need:
    """What a task asks for, by what its probe found. A failed probe measures nothing."""
    if isinstance(task.params, CommandParams):
        return Need(gpu_share=task.params.judge.gpus, cpus=task.params.judge.cpus)
    share = largest_share(gpus_per_training)
    if probe is None or not store.has(probe):
        return Need(voxel_memory(task), share if task.gpu else 0.0)
    found = store.load(probe)
    if gpus_per_training == "auto" and found.gpu_share is not None:
        share = rounded_share(found.gpu_share * _MARGIN)
    memory = int(store.record(probe).peak_memory * _MARGIN)
    return Need(memory, share, found.batch_size)


def largest_share(gpus_per_training: float | Literal["auto"]) -> float:
    """Share of a GPU that a training may take at most."""
    return 1.0 if gpus_per_training == "auto" else gpus_per_training


def rounded_share(share: float) -> float:
    """The next larger 1/n, so that n trainings fill a GPU; a whole GPU beyond a half."""
    return 1 / max(1, math.floor(1 / share)) if share > 0 else 0.01
