"""Memory of this machine, and whether the voxels of a sweep fit into it."""

import math
from collections.abc import Iterable
from pathlib import Path

from rich.filesize import decimal

from lidarplace.base.errors import InputError
from sweeps.stages.stage import VoxelStage
from sweeps.stages.task import Task


def check_memory(tasks: Iterable[Task], ray: str) -> None:
    """Check that the voxels of each task fit into the memory of this machine.

    Not if `ray` is the address of a cluster, which does the tasks elsewhere. Raises InputError."""
    stages = [task.stage for task in tasks if isinstance(task.stage, VoxelStage)]
    largest = max(stages, key=lambda stage: stage.need().memory, default=None)
    total, _ = machine_memory()
    if largest is None or ray not in ("local", "debug") or largest.need().memory <= total:
        return
    roi = largest.roi
    raise InputError(
        f"{math.prod(roi.shape):.3g} voxels of {roi.resolution:g} m need "
        f"{decimal(largest.need().memory)} of memory ({largest.name})",
        key="surrogate.resolution",
        expected=f"at most {decimal(total)}, all that this machine has",
        fix="use larger voxels or a smaller roi",
    )


def machine_memory() -> tuple[int, int]:
    """Return the bytes of RAM of this machine or its container, and how many are free."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    kib = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    total, available = kib["MemTotal"] * 1024, kib["MemAvailable"] * 1024
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text(encoding="ascii").strip()) != "max":
        total = min(total, int(text))
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
        available = min(available, total - used)
    return total, max(0, available)
