"""What tasks ask of a machine."""

from dataclasses import dataclass

from sweeps.execution.memory import voxel_memory
from sweeps.tasks.parameters import CommandParams
from sweeps.tasks.task import Task


@dataclass(frozen=True)
class Need:
    """What a task asks for.

    Attributes:
        memory: bytes; 0 if unknown.
        gpu_share: of one GPU; more of a command.
    """

    memory: int = 0
    gpu_share: float = 0.0
    cpus: int = 1


def need_of(task: Task, gpus_per_training: float) -> Need:
    """What a task asks for, and of a GPU, where it runs on one, the share of the configuration."""
    if isinstance(task.params, CommandParams):
        return Need(gpu_share=task.params.judge.gpus, cpus=task.params.judge.cpus)
    return Need(voxel_memory(task), gpus_per_training if task.gpu else 0.0)
