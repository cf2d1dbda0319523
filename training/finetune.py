"""Train a detector on point clouds."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from lidarplace.lidar.clouds import Clouds
from training import build_detector
from training.dataset import TrainingFrames, as_tensors, augment, within_range
from training.detectors.detector import Detector, PointRange
from training.device import device
from training.one_cycle import OneCycle
from training.settings import TrainingSettings


@dataclass(frozen=True)
class FinetuneResult:
    """What a training leaves.

    Attributes:
        state_dict: weights and buffers, CPU tensors.
        curve: columns epoch (from 1), metric, value. Metrics: the mean of every part of the loss
            over the epoch's steps, "lr" of its last step, "seconds" it took.
        steps: optimisation steps.
    """

    state_dict: dict[str, Tensor]
    curve: pd.DataFrame
    steps: int


def finetune(
    detector: str,
    classes: Sequence[str],
    clouds: Clouds,
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    seed: int,
    point_range: PointRange | None = None,
    on_epoch: Callable[[dict[str, float]], None] | None = None,
) -> FinetuneResult:
    """Train `detector` on all frames of `clouds`, on a GPU if there is one.

    Args:
        detector: name for `build_detector`.
        classes: classes to detect.
        clouds: points, ego frame; frames without points are fine.
        ground_truth: frame, class, x, y, z, length, width, height, yaw, ego frame.
        settings: how to train, and from which weights.
        seed: of the weights, the order of frames and the augmentation. The same seed gives the
            same result on a CPU; the caller's random state is left alone.
        point_range: range for `build_detector`, ego frame.
        on_epoch: called after each epoch with the epoch's number and its values in `curve`.

    Raises:
        ValueError: no frames, unknown detector or class, bad ground truth, a checkpoint that does
            not fit.
        ArithmeticError: the loss is no longer a finite number.
    """
    if len(clouds) == 0:
        raise ValueError("training needs at least one frame, found none")
    random = np.random.default_rng(seed)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = build_detector(detector, classes, point_range=point_range)
    if settings.checkpoint is not None:
        _load(model, settings.checkpoint)
    model.to(device())
    frames = TrainingFrames(classes, clouds, ground_truth, model.sensor_height, settings.min_points)
    steps = settings.epochs * -(-len(frames) // settings.batch_size)
    optimizer = _optimizer(model, settings)
    schedule = OneCycle(settings, steps)
    rows: list[tuple[int, str, float]] = []
    step = 0
    for epoch in range(1, settings.epochs + 1):
        start = time.perf_counter()
        model.train()
        parts: dict[str, list[Tensor]] = defaultdict(list)
        order = random.permutation(len(frames))
        for first in range(0, len(order), settings.batch_size):
            samples = [
                within_range(augment(frames[i], settings, random), model.point_range)
                for i in order[first : first + settings.batch_size]
            ]
            _set_step(optimizer, *schedule(step))
            losses = model.loss(*as_tensors(samples))
            optimizer.zero_grad()
            losses["loss"].backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), settings.grad_norm_clip)
            optimizer.step()
            model.global_step += 1
            step += 1
            for name, value in losses.items():
                parts[name].append(value.detach())
        values = {name: torch.stack(items).mean().item() for name, items in parts.items()}
        if not np.isfinite(values["loss"]):
            raise ArithmeticError(
                f"the loss of epoch {epoch} is {values['loss']}; a lower lr than {settings.lr} "
                "may help"
            )
        values["lr"] = optimizer.param_groups[0]["lr"]
        values["seconds"] = time.perf_counter() - start
        rows.extend((epoch, name, value) for name, value in values.items())
        if on_epoch is not None:
            on_epoch({"epoch": epoch, **values})
    state = {name: value.detach().cpu().clone() for name, value in model.state_dict().items()}
    return FinetuneResult(state, pd.DataFrame(rows, columns=["epoch", "metric", "value"]), step)


def _load(model: Detector, path: Path) -> None:
    """Load a state_dict, or OpenPCDet's checkpoint with one under "model_state"."""
    content = torch.load(path, map_location="cpu", weights_only=True)
    try:
        model.load_state_dict(content.get("model_state", content))
    except RuntimeError as error:
        raise ValueError(f"checkpoint {path} does not fit the detector: {error}") from error


def _optimizer(model: Detector, settings: TrainingSettings) -> torch.optim.Optimizer:
    if settings.optimizer == "sgd":
        return torch.optim.SGD(
            model.parameters(),
            lr=settings.lr,
            momentum=settings.momentum,
            weight_decay=settings.weight_decay,
        )
    # AdamW's decay is fastai's "true weight decay"; 0.99 is OpenPCDet's second coefficient.
    return torch.optim.AdamW(
        model.parameters(),
        lr=settings.lr,
        betas=(settings.moms[0], 0.99),
        weight_decay=settings.weight_decay,
        foreach=True,
    )


def _set_step(optimizer: torch.optim.Optimizer, lr: float, momentum: float) -> None:
    for group in optimizer.param_groups:
        group["lr"] = lr
        if "betas" in group:
            group["betas"] = (momentum, group["betas"][1])
