"""Train a detector on point clouds."""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Clouds
from lidarplace.logs.boxes import CLASSES, check_boxes
from training.augment import Augmentation
from training.batch_size import batch_size_for
from training.checkpoints import load_checkpoint, read_checkpoint
from training.dataset import TrainingFrames, as_tensors
from training.detectors.build import build
from training.detectors.detector import Detector, PointRange
from training.device import device, gpu_count
from training.ground_truth_sampling import ObjectDatabase
from training.optimisation import Optimisation
from training.randomness import Purpose, generator, stream
from training.resume import TrainingFolder, TrainingState, fingerprint
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject, as_plain, from_plain, typical_objects


@dataclass(frozen=True)
class FinetuneResult:
    """Weights and learning curve of a training."""

    state_dict: dict[str, Tensor]  # weights and buffers after the last epoch, CPU tensors
    # Columns epoch (from 1), metric, value. Metrics: the mean of every part of the loss over the
    # epoch's steps, "lr" of its last step, "seconds" it took
    curve: pd.DataFrame
    batch_size: int  # frames of a step
    batch_size_reduced: bool  # whether these are fewer than there should be, for want of GPU memory
    # "scratch", "generalist", or the checkpoint's name and digest, and its entries not used
    weights: str
    earlier_seconds: float  # of the epochs before a stop, not spent in this call
    typical: tuple[TypicalObject, ...]  # objects of which the anchors are that are not the preset's


@dataclass(frozen=True)
class TrainingContext:
    """Circumstances of a training that are not its settings."""

    point_range: PointRange | None = None  # for `training.build_detector`, ego frame
    # Objects of which anchors are, of classes that the preset does not know, or that shall have
    # others. Those of a checkpoint come before those of the ground truth
    typical: Sequence[TypicalObject] = ()
    digest: str | None = None  # SHA-256 that the checkpoint of the settings must have; None: any
    # Weights to start from, of a detector of the same network and classes, trained on the clouds of
    # many rigs; None: those of the settings' checkpoint, without one at random
    generalist: Mapping[str, Tensor] | None = None
    # Keeps the training after each epoch, see `TrainingFolder`; one that was stopped goes on from
    # there and gives what it would have given
    folder: Path | None = None
    # How often the frames of a step are halved, to at least 1, as memory was too small. A training
    # that was stopped goes on with the frames that it had, unless these are more
    halvings: int = 0
    on_step: Callable[[float], None] = lambda epochs: None  # gets the epochs done, such as 2.35


def finetune(
    detector: str,
    classes: Sequence[str],
    clouds: Clouds,
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    seed: int,
    context: TrainingContext = TrainingContext(),
) -> FinetuneResult:
    """Train `detector` on the frames of `clouds`, on a GPU if there is one.

    Args:
        detector: name for `training.build_detector`.
        classes: classes to detect.
        clouds: points, ego frame; frames without points are fine.
        ground_truth: frame, class, x, y, z, length, width, height, yaw, ego frame.
        settings: how to train, and from which weights.
        seed: of the weights, the order of frames, the augmentation and what the network draws.
            The same seed gives the same result on a CPU; the caller's random state is left alone.
        context: range, anchors, weights to start from, and where the training is kept.

    Raises:
        ValueError: no frames, unknown detector or class, bad ground truth, a checkpoint that does
            not fit or has another digest, or a folder of another training.
        OSError: a checkpoint that cannot be read.
        ArithmeticError: the loss or its gradient is no longer a finite number; names the frames."""
    if len(clouds) == 0:
        raise InputError(key="clouds", expected="at least one frame", found="none")
    typical = _typical(classes, ground_truth, settings, context.typical)
    with torch.random.fork_rng(range(gpu_count())):
        torch.manual_seed(seed)
        model = build(detector, classes, point_range=context.point_range, typical=typical)
        weights = _load_weights(model, settings, context)
        model.to(device())
        about = {"detector": detector, "classes": list(classes), "seed": seed, "weights": weights}
        identity = _identity(model, settings) | about
        folder = TrainingFolder(context.folder, fingerprint(identity, clouds, ground_truth))
        least, share = settings.min_points, settings.frame_share
        frames = TrainingFrames(classes, clouds, ground_truth, model.sensor_height, least, share)
        database = ObjectDatabase.of(frames, classes, settings.sample_groups, least)
        augmentation = Augmentation(settings, model.point_range, database)
        stopped = folder.load()
        state, batch_size, reduced = _start(stopped, context.halvings, model, frames, settings)
        steps = settings.epochs * -(-len(frames) // batch_size)
        optimisation = Optimisation(model, settings, steps)
        if state is not None:
            model.load_state_dict(state.model)
            optimisation.load_state_dict(state.optimisation)
        curve = state.curve if state else []
        earlier = sum(value for _, name, value in curve if name == "seconds")
        parts = (model, optimisation, frames, augmentation, batch_size)
        for epoch in range(state.epoch + 1 if state else 1, settings.epochs + 1):
            values = _train_epoch(*parts, (seed, epoch), context.on_step)
            curve.extend((epoch, name, value) for name, value in values.items())
            states = model.state_dict(), optimisation.state_dict()
            folder.save(TrainingState(epoch, batch_size, reduced, *states, curve))
    state_dict = {name: value.detach().cpu().clone() for name, value in model.state_dict().items()}
    table = pd.DataFrame(curve, columns=["epoch", "metric", "value"])
    return FinetuneResult(state_dict, table, batch_size, reduced, weights, earlier, model.typical)


def _identity(model: Detector, settings: TrainingSettings) -> dict[str, object]:
    """Settings, range and anchors of a training, of which its folder keeps a fingerprint."""
    identity = settings.model_dump(mode="json") | {"point_range": model.point_range}
    return identity | ({"typical": as_plain(model.typical)} if model.typical else {})


def _typical(
    classes: Sequence[str],
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    typical: Sequence[TypicalObject],
) -> tuple[TypicalObject, ...]:
    """Add objects of the checkpoint, and for other unknown classes of the ground truth."""
    by_name = {item.name: item for item in typical}
    if settings.checkpoint is not None:
        of_checkpoint = from_plain(read_checkpoint(settings.checkpoint)[0])
        by_name = {item.name: item for item in of_checkpoint if item.name in classes} | by_name
    check_boxes(ground_truth, "ground truth")
    unknown = [name for name in classes if name not in CLASSES and name not in by_name]
    return (*by_name.values(), *typical_objects(ground_truth, unknown))


def _start(
    state: TrainingState | None,
    halvings: int,
    model: Detector,
    frames: TrainingFrames,
    settings: TrainingSettings,
) -> tuple[TrainingState | None, int, bool]:
    """State to go on from, frames of a step, and whether these are fewer than there should be."""
    if state is not None and not halvings:  # what was found before a stop stays
        return state, state.batch_size, state.batch_size_reduced
    wanted = batch_size_for(model, frames, settings)
    batch_size = max(1, wanted >> halvings)
    if state is not None and state.batch_size > batch_size:
        state = None  # it ran out of memory
    return state, batch_size, batch_size < wanted


def _train_epoch(
    model: Detector,
    optimisation: Optimisation,
    frames: TrainingFrames,
    augmentation: Augmentation,
    batch_size: int,
    seed: tuple[int, int],
    on_step: Callable[[float], None],
) -> dict[str, float]:
    """Train on all frames once; return the values of the curve.

    All randomness follows from `seed`, which is the training's and the epoch."""
    start = time.perf_counter()
    model.train()
    parts: dict[str, list[Tensor]] = defaultdict(list)
    order = generator(Purpose.ORDER, *seed).permutation(len(frames))
    for first in range(0, len(order), batch_size):
        rows = order[first : first + batch_size]
        samples = [augmentation(frames[row], (*seed, row)) for row in rows.tolist()]
        state = stream(Purpose.NETWORK, *seed, first).generate_state(1, np.uint64)
        torch.manual_seed(int(state[0]))  # networks draw from torch's generator
        try:
            losses = optimisation.step(as_tensors(samples))
        except ArithmeticError as error:
            if type(error) is not ArithmeticError:  # of the network's own code
                raise
            place = f"epoch {seed[1]}, step {1 + first // batch_size}"
            raise ArithmeticError(
                f"{error} in {place}, frames {frames.numbers[rows].tolist()}; a lower lr than "
                f"{augmentation.settings.lr} may help"
            ) from None
        for name, value in losses.items():
            parts[name].append(value)
        on_step(seed[1] - 1 + (first + len(rows)) / len(order))
    values = {name: torch.stack(items).mean().item() for name, items in parts.items()}
    return values | {"lr": optimisation.lr, "seconds": time.perf_counter() - start}


def _load_weights(model: Detector, settings: TrainingSettings, context: TrainingContext) -> str:
    """Load the weights that training starts from; return `FinetuneResult.weights`."""
    if context.generalist is not None:
        model.load_state_dict(context.generalist)
        return "generalist"
    if (path := settings.checkpoint) is None:
        return "scratch"
    report = load_checkpoint(model, path, settings.new_heads)
    if context.digest not in (None, report.digest):
        raise InputError("has changed since the training was planned", place=path)
    origin = f"{path.name} sha256:{report.digest[:12]}"
    if report.reinitialised:
        origin += f", from scratch: {', '.join(report.reinitialised)}"
    return origin
