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
from training.device import device
from training.ground_truth_sampling import ObjectDatabase
from training.optimisation import Optimisation
from training.randomness import Purpose, generator, stream
from training.resume import TrainingFolder, TrainingState, fingerprint
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject, as_plain, from_plain, typical_objects


@dataclass(frozen=True)
class FinetuneResult:
    """What a training leaves."""

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
class StartingWeights:
    """What a training starts from, where the settings name no checkpoint: at random by default."""

    digest: str | None = None  # SHA-256 that the checkpoint of the settings must have; None: any
    # Weights of a detector of the same network and classes, trained on the clouds of many rigs
    generalist: Mapping[str, Tensor] | None = None


def finetune(
    detector: str,
    classes: Sequence[str],
    clouds: Clouds,
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    seed: int,
    point_range: PointRange | None = None,
    on_step: Callable[[float], None] = lambda epochs: None,
    folder: Path | None = None,
    start: StartingWeights = StartingWeights(),
    halvings: int = 0,
    typical: Sequence[TypicalObject] = (),
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
        point_range: range for `training.build_detector`, ego frame.
        on_step: called after each step with the epochs that are done, such as 2.35.
        folder: keeps the training after each epoch, see `TrainingFolder`; one that was stopped
            goes on from there and gives what it would have given.
        start: weights to start from, if they are not at random.
        halvings: how often the frames of a step are halved, to at least 1, as memory was too small.
            A training that was stopped goes on with the frames that it had, unless these are more.
        typical: objects of which anchors are, of classes that the preset does not know, or that
            shall have others. Those of a checkpoint come before those of `ground_truth`.

    Raises:
        ValueError: no frames, unknown detector or class, bad ground truth, a checkpoint that does
            not fit or has another digest, or a folder of another training.
        OSError: a checkpoint that cannot be read.
        ArithmeticError: the loss or its gradient is no longer a finite number; names the frames.
    """
    if len(clouds) == 0:
        raise InputError(key="clouds", expected="at least one frame", found="none")
    typical = _typical(classes, ground_truth, settings, typical)
    with torch.random.fork_rng(range(torch.cuda.device_count())):
        torch.manual_seed(seed)
        model = build(detector, classes, point_range=point_range, typical=typical)
        weights = _load_weights(model, settings, start)
        model.to(device())
        height, least = model.sensor_height, settings.min_points
        share = settings.frame_share
        frames = TrainingFrames(classes, clouds, ground_truth, height, least, share)
        database = ObjectDatabase.of(frames, classes, settings.sample_groups, least)
        augmentation = Augmentation(settings, model.point_range, database)
        own = {"detector": detector, "classes": list(classes), "seed": seed, "weights": weights}
        identity = settings.model_dump(mode="json") | own | {"point_range": model.point_range}
        if model.typical:
            identity["typical"] = as_plain(model.typical)
        kept = TrainingFolder(folder, fingerprint(identity, clouds, ground_truth))
        state, batch_size, reduced = _start(kept.load(), halvings, model, frames, settings)
        steps = settings.epochs * -(-len(frames) // batch_size)
        optimisation = Optimisation(model, settings, steps)
        if state is not None:
            model.load_state_dict(state.model)
            optimisation.load_state_dict(state.optimisation)
        curve = state.curve if state else []
        earlier = sum(value for _, name, value in curve if name == "seconds")
        for epoch in range(state.epoch + 1 if state else 1, settings.epochs + 1):
            values = _train_epoch(
                model, optimisation, frames, augmentation, batch_size, (seed, epoch), on_step
            )
            curve.extend((epoch, name, value) for name, value in values.items())
            now = model.state_dict(), optimisation.state_dict()
            kept.save(TrainingState(epoch, batch_size, reduced, *now, curve))
    state_dict = {name: own.detach().cpu().clone() for name, own in model.state_dict().items()}
    table = pd.DataFrame(curve, columns=["epoch", "metric", "value"])
    about = (batch_size, reduced, weights, earlier, model.typical)
    return FinetuneResult(state_dict, table, *about)


def _typical(
    classes: Sequence[str],
    ground_truth: pd.DataFrame,
    settings: TrainingSettings,
    given: Sequence[TypicalObject],
) -> tuple[TypicalObject, ...]:
    """Those given, and of classes that nothing knows those of the checkpoint or of the objects."""
    known = {item.name: item for item in given}
    if settings.checkpoint is not None:
        kept = from_plain(read_checkpoint(settings.checkpoint)[0])
        known = {item.name: item for item in kept if item.name in classes} | known
    check_boxes(ground_truth, "ground truth")
    unknown = [name for name in classes if name not in CLASSES and name not in known]
    return (*known.values(), *typical_objects(ground_truth, unknown))


def _start(
    state: TrainingState | None,
    halvings: int,
    model: Detector,
    frames: TrainingFrames,
    settings: TrainingSettings,
) -> tuple[TrainingState | None, int, bool]:
    """Where to go on, the frames of a step, and whether these are fewer than there should be."""
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
    """One pass over all frames; its values. All randomness follows from `seed` and epoch."""
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


def _load_weights(model: Detector, settings: TrainingSettings, start: StartingWeights) -> str:
    """Load the weights that training starts from; what these are."""
    if start.generalist is not None:
        model.load_state_dict(start.generalist)
        return "generalist"
    if (path := settings.checkpoint) is None:
        return "scratch"
    report = load_checkpoint(model, path, settings.new_heads)
    if start.digest not in (None, report.digest):
        raise InputError("has changed since the training was planned", place=path)
    origin = f"{path.name} sha256:{report.digest[:12]}"
    if report.reinitialised:
        origin += f", from scratch: {', '.join(report.reinitialised)}"
    return origin
