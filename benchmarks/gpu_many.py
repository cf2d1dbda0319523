"""Many frames of one network, and many networks: rigs evaluated, and trainings side by side."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from gpu_networks import batch_of, stepping, synchronize
from torch import Tensor, nn
from torch.func import functional_call, grad_and_value, stack_module_state

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import CLASSES
from training import build_detector
from training.checkpoints import read_checkpoint
from training.detect import detect
from training.kitti_ap import evaluate_boxes
from training.optimisation import Optimisation
from training.settings import PRETRAINED, TrainingSettings
from training.typical_objects import from_plain

LOG = Path(__file__).parents[1] / "sweeps/benchmark/log"
X, Y, Z = (0.0, 40.0), (-20.0, 20.0), (0.0, 4.0)
FRAMES = 4  # of a training step
VALUE = {"metric": "AP_R40_3D_mean", "class": "Car"}


def measure_rigs(device: str, frames: int) -> list[dict]:
    """Seconds to cast, predict and evaluate the frames of a rig, and rho with the CPU's values."""
    log = read_box_log(LOG)
    numbers = np.sort(log.frames.loc[log.frames["split"] == "test", "frame"].to_numpy(np.int64))
    numbers = numbers[:frames]
    content, _ = read_checkpoint(PRETRAINED)
    classes, typical = content["classes"], from_plain(content)
    objects = ground_truth(log, X, Y, Z)
    objects = objects[objects["frame"].isin(numbers) & objects["class"].isin(classes)]
    lidar = replace(Lidar.paper(), azimuth_steps=900, range_noise=0.02, drop_off=0.05)

    def value(name: str) -> float:
        placement = PAPER_PLACEMENTS[name].with_lidar(lidar)
        crop = crop_for(X, Y, Z, placement)
        clouds = SimulatedClouds(log, numbers, placement, crop)
        settings = TrainingSettings(batch_size="auto")
        options: dict[str, Any] = {"point_range": crop, "typical": typical}
        state, network = content["model_state"], content["detector"]
        boxes = detect(network, classes, state, clouds, settings, **options).boxes
        table = evaluate_boxes(objects, boxes, numbers.tolist(), classes).set_index(list(VALUE))
        return float(table.loc[tuple(VALUE.values()), "value"].max())

    rows = []
    for place in dict.fromkeys([device, "cpu"]):
        with patch("training.detect.device", lambda place=place: torch.device(place)):
            value("line")  # compiles
            start = time.perf_counter()
            value("line")
            one = time.perf_counter() - start
            values = [value(name) for name in PAPER_PLACEMENTS]
            eight = time.perf_counter() - start - one
        rows.append({"device": place, "frames": len(numbers), "a rig (s)": one,
                     "8 rigs (s)": eight, "values": values})  # fmt: skip
    if len(rows) == 2:
        ranks = [np.argsort(np.argsort(row["values"])) for row in rows]
        rows[0]["rho with the CPU"] = float(np.corrcoef(*ranks)[0, 1])
    return rows


class Dense(nn.Module):
    """Backbone and head of PointPillars, whose loss `vmap` can return."""

    def __init__(self, model: Any) -> None:
        super().__init__()
        self.backbone, self.head = model.backbone_2d, model.dense_head

    def forward(self, image: Tensor) -> Tensor:
        """A loss of images (B, C, ny, nx), which stands for the detector's."""
        output = self.head(self.backbone(image))
        residuals, directions = self.head.raw_boxes(output)
        return sum(item.square().mean() for item in (output.logits, residuals, directions))


def networks(count: int, device: str) -> list[Any]:
    """Networks that differ in their weights."""
    models = []
    for seed in range(count):
        torch.manual_seed(seed)
        models.append(build_detector("pointpillars_tiny", CLASSES).to(device).train())
    return models


def one_by_one(dense: list[Dense], images: Tensor) -> Tensor:
    """Losses of the networks, one after another; gradients are added to those of the weights."""
    losses = torch.stack([model(image) for model, image in zip(dense, images, strict=True)])
    losses.sum().backward()
    return losses.detach()


def grouped(dense: list[Dense], images: Tensor) -> Callable[[], tuple[dict[str, Tensor], Tensor]]:
    """Make a function of the gradients and losses of all networks at once."""
    weights, buffers = stack_module_state(dense)  # type: ignore[arg-type]
    run = torch.func.vmap(
        grad_and_value(lambda *state: functional_call(dense[0], state[:2], (state[2],)))
    )
    return lambda: run(weights, buffers, images)


def measure_trainings(count: int, device: str, window_s: float) -> dict[str, float]:
    """Frames a second together of `count` trainings of a tiny network.

    Grouped at best: all but the dense part goes on one after another."""
    torch.set_num_threads(1)
    models = networks(count, device)
    steps = [training(model) for model in models]
    dense = [Dense(model) for model in models]
    image = models[0]._pillars(batch_of(models[0], FRAMES)[0]).detach()
    images = torch.stack([image] * count)
    whole, alone, joint = (
        count * FRAMES * rate(step, device, window_s)
        for step in (
            lambda: [step() for step in steps],
            lambda: one_by_one(dense, images),
            grouped(dense, images),
        )
    )
    row = {"trainings": count, "one after another": whole}
    if count > 1:
        row["threads"] = count * FRAMES * in_threads(steps, device, window_s)
        row["processes"] = count * FRAMES * in_processes(count, device, window_s)
    row |= {"dense part, one after another": alone, "dense part, grouped": joint}
    return row | {"grouped, at best": 1 / (1 / whole - 1 / alone + 1 / joint)}


def training(model: Any) -> Callable[[], object]:
    """Make a function of a training step on a batch of its own."""
    settings = TrainingSettings(mixed_precision=False, lr=1e-4)
    return stepping(Optimisation(model, settings, steps=10**6), model, batch_of(model, FRAMES))


def rate(step: Callable[[], object], device: str, window_s: float) -> float:
    """Return steps a second, after two that compile."""
    for _ in range(2):
        step()
    synchronize(device)
    done, start = 0, time.perf_counter()
    while time.perf_counter() - start < window_s:
        step()
        done += 1
        synchronize(device)
    return done / (time.perf_counter() - start)


def in_threads(steps: list[Callable[[], object]], device: str, window_s: float) -> float:
    """Return rounds of all steps a second, by a thread and, on a GPU, a stream each."""
    rates = [0.0] * len(steps)

    def run(index: int) -> None:
        if device == "cuda":
            with torch.cuda.stream(torch.cuda.Stream()):
                rates[index] = rate(steps[index], "cpu", window_s)
        else:
            rates[index] = rate(steps[index], device, window_s)

    threads = [threading.Thread(target=run, args=(index,)) for index in range(len(steps))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    synchronize(device)
    return sum(rates) / len(rates)


def in_processes(count: int, device: str, window_s: float) -> float:
    """Return rounds of all steps a second, by a process each."""
    spawn = multiprocessing.get_context("spawn")
    barrier, rates = spawn.Barrier(count), spawn.SimpleQueue()
    arguments = (barrier, rates, device, window_s)
    processes = [spawn.Process(target=in_process, args=arguments) for _ in range(count)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60 + 5 * window_s)
        process.kill()
    if any(process.exitcode for process in processes):
        raise RuntimeError(f"{count} processes: not all ended well")
    return sum(rates.get() for _ in range(count)) / count


def in_process(barrier: Any, rates: Any, device: str, window_s: float) -> None:
    """Train one network when all processes are ready."""
    torch.set_num_threads(1)
    step = training(networks(1, device)[0])
    step()
    synchronize(device)
    barrier.wait(60)
    rates.put(rate(step, device, window_s))
