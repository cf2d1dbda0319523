"""What tasks need of a machine: memory of voxels, known before anything runs, GPUs and CPUs."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rich.filesize import decimal

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from sweeps.tasks.parameters import CommandParams
from sweeps.tasks.task import Task

_BYTES_A_VOXEL = {
    "pog": (4, 4),
    "surrogates": (8, 0),
    "accuracy": (15, 0),
    "sampling_error": (36, 9),
}
"""Of each stage, and further of each class: at most, where every voxel is occupied, as measured by
`benchmarks/voxel_memory.py`. What is mapped from files does not count."""

_OCCLUSION = 9
"""Bytes a voxel more where occlusion is asked for."""


def voxel_memory(task: Task) -> int:
    """Bytes that a task holds for the voxels of its ROI; 0 if it has none."""
    if task.stage not in _BYTES_A_VOXEL:
        return 0
    own, of_class = _BYTES_A_VOXEL[task.stage]
    own += of_class * len(getattr(task.params, "classes", ()))
    own += _OCCLUSION * getattr(task.params, "occlusion", False)
    return math.prod(_roi_of(task).shape) * own


def _roi_of(task: Task) -> Roi:
    roi: Roi = (task.inputs[0] if task.stage == "surrogates" else task).params.roi
    return roi


def check_memory(tasks: Iterable[Task], ray: str) -> None:
    """Raise ValueError if the voxels of a task cannot fit into this machine's memory, where it does
    the tasks: not if `ray` is the address of a cluster."""
    largest = max(tasks, key=voxel_memory, default=None)
    total, _ = machine_memory()
    if largest is not None and ray in ("local", "debug") and voxel_memory(largest) > total:
        roi = _roi_of(largest)
        problem = f"{math.prod(roi.shape):.3g} voxels of {roi.resolution:g} m need "
        problem += f"{decimal(voxel_memory(largest))} of memory ({largest.stage})"
        expected = f"at most {decimal(total)}, all that this machine has"
        fix = "use larger voxels or a smaller roi"
        raise InputError(problem, key="surrogate.resolution", expected=expected, fix=fix)


def machine_memory() -> tuple[int, int]:
    """Bytes of RAM of this machine or its container, and those that are free."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    kib = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    total, available = kib["MemTotal"] * 1024, kib["MemAvailable"] * 1024
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text(encoding="ascii").strip()) != "max":
        total = min(total, int(text))
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
        available = min(available, total - used)
    return total, max(0, available)


@dataclass(frozen=True)
class Need:
    """Memory in bytes, 0 if unknown; the share of one GPU, of a command more; and CPUs."""

    memory: int = 0
    gpu_share: float = 0.0
    cpus: int = 1


def need_of(task: Task, gpus_per_training: float) -> Need:
    if isinstance(task.params, CommandParams):
        return Need(gpu_share=task.params.evaluator.gpus, cpus=task.params.evaluator.cpus)
    return Need(voxel_memory(task), gpus_per_training if task.gpu else 0.0)
