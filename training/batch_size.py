"""How many frames make a step."""

import copy
from collections.abc import Callable
from dataclasses import dataclass

import torch

from training.dataset import TrainingFrames, as_tensors
from training.detectors.detector import Detector
from training.optimisation import Optimisation
from training.settings import LARGEST_BATCH, TrainingSettings

ON_CPU = 4
MEMORY_SHARE = 0.8
"""Of the GPU memory that others leave; the rest is for frames that grow by augmentation."""


@dataclass(frozen=True)
class Memory:
    """What is known of the memory that a training has.

    Attributes:
        frames: of a step that it holds, where the settings say "auto"; None: it is found out.
        halvings: how often the frames of a step are halved, to at least 1, as it was too small.
    """

    frames: int | None = None
    halvings: int = 0


def batch_size_for(
    model: Detector, frames: TrainingFrames, settings: TrainingSettings, gpu_share: float = 1.0
) -> int:
    """The batch size of the settings; for "auto", 4 on a CPU and what its memory holds on a GPU.

    Of a GPU's memory no more than `gpu_share` is taken.

    On a GPU one step is tried on the largest frames, with a copy of `model`. Networks may draw
    random numbers in it.
    """
    if settings.batch_size != "auto":
        return settings.batch_size
    if model.device.type == "cpu":
        return ON_CPU
    return largest_that_fits(lambda size: _fits(model, frames, settings, size, gpu_share))


def largest_that_fits(fits: Callable[[int], bool]) -> int:
    """The largest power of two up to 16 below which all fit; 1 if none does."""
    size = 1
    while size < LARGEST_BATCH and fits(2 * size):
        size *= 2
    return size


def step_bytes(
    model: Detector, frames: TrainingFrames, settings: TrainingSettings, size: int
) -> int | None:
    """GPU memory that one step with the `size` largest frames adds to what is taken already.

    0 on a CPU, where it is not counted; None if the step does not fit.
    """
    gpu = None if model.device.type == "cpu" else torch.get_device_module(model.device)
    if gpu:
        gpu.empty_cache()
        gpu.reset_peak_memory_stats(model.device)
    before = gpu.memory_reserved(model.device) if gpu else 0
    try:
        trial = Optimisation(copy.deepcopy(model).train(), settings, steps=1)
        trial.step(as_tensors(frames.largest(size)))
    except torch.OutOfMemoryError:
        return None
    except ArithmeticError:
        pass  # its memory is known all the same; the training will name the frames
    return gpu.max_memory_reserved(model.device) - before if gpu else 0


def _fits(
    model: Detector, frames: TrainingFrames, settings: TrainingSettings, size: int, share: float
) -> bool:
    """Whether one step with `size` frames stays within the share of the memory."""
    gpu = torch.get_device_module(model.device)
    gpu.empty_cache()
    free, total = gpu.mem_get_info(model.device)
    taken = step_bytes(model, frames, settings, size)
    return taken is not None and taken <= MEMORY_SHARE * min(free, share * total)
