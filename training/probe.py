"""What one step of a training needs of a machine."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
import torch

from lidarplace.clouds.clouds import Clouds
from training.batch_size import batch_size_for, step_bytes
from training.detectors.build import build
from training.detectors.detector import PointRange
from training.device import device
from training.finetune import training_data
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject


@dataclass(frozen=True)
class Probe:
    """What a step needs.

    Attributes:
        batch_size: frames in it.
        gpu_share: of a GPU's memory, at its peak, in [0, 1]; None without a GPU, and if the step
            did not fit.
    """

    batch_size: int
    gpu_share: float | None


def probe(
    detector: str,
    classes: Sequence[str],
    clouds: Clouds,
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    point_range: PointRange | None = None,
    gpu_share: float = 1.0,
    typical: Sequence[TypicalObject] = (),
) -> Probe:
    """Take one step of a training, on the largest frames, and look at its memory.

    All that a training builds in addition to the network is built here too, so that the peak of
    this process's memory is that of a training. Arguments as of `finetune`, which raises the same,
    and the share of a GPU's memory that a training may take.
    """
    torch.manual_seed(0)
    model = build(detector, classes, point_range=point_range, typical=typical).to(device())
    frames, database = training_data(model, classes, clouds, ground_truth, settings)
    batch_size = batch_size_for(model, frames, settings, gpu_share)
    taken = step_bytes(model, frames, settings, batch_size)
    del database  # it had to be there until now
    if model.device.type == "cpu" or taken is None:
        return Probe(batch_size, None)
    gpu = torch.get_device_module(model.device)
    _, total = gpu.mem_get_info(model.device)
    peak = gpu.max_memory_reserved(model.device)  # with the network itself
    return Probe(batch_size, min(1.0, peak / total))
