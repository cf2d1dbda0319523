"""Number of frames of a training step."""

import copy

import torch

from training.dataset import TrainingFrames, as_tensors
from training.detectors.detector import Detector
from training.nvidia import is_out_of_memory
from training.optimisation import Optimisation
from training.settings import LARGEST_BATCH, TrainingSettings

ON_CPU = 4
MEMORY_SHARE = 0.8
"""Of the GPU memory that others leave; the rest is for frames that grow by augmentation."""


def batch_size_for(model: Detector, frames: TrainingFrames, settings: TrainingSettings) -> int:
    """Choose the batch size of the settings; for "auto", 4 on a CPU.

    On a GPU "auto" is the largest power of two up to 16 that its memory holds: one step is tried on
    the largest frames, with a copy of `model`. Networks may draw random numbers in it."""
    if settings.batch_size != "auto":
        return settings.batch_size
    if model.device.type == "cpu":
        return ON_CPU
    size = 1
    while size < LARGEST_BATCH and _fits(model, frames, settings, 2 * size):
        size *= 2
    return size


def _fits(model: Detector, frames: TrainingFrames, settings: TrainingSettings, size: int) -> bool:
    gpu = torch.get_device_module(model.device)
    gpu.empty_cache()
    free, _ = gpu.mem_get_info(model.device)
    taken = step_bytes(model, frames, settings, size)
    return taken is not None and taken <= MEMORY_SHARE * free


def step_bytes(
    model: Detector, frames: TrainingFrames, settings: TrainingSettings, size: int
) -> int | None:
    """Measure the GPU memory that a step with the `size` largest frames adds; None: too much."""
    gpu = torch.get_device_module(model.device)
    gpu.empty_cache()
    gpu.reset_peak_memory_stats(model.device)
    before = gpu.memory_reserved(model.device)
    try:
        trial = Optimisation(copy.deepcopy(model).train(), settings, steps=1)
        trial.step(as_tensors(frames.largest(size)))
    except RuntimeError as error:
        if is_out_of_memory(error):
            return None
        raise
    except ArithmeticError:
        pass  # its memory is known all the same; the training will name the frames
    return int(gpu.max_memory_reserved(model.device) - before)
