"""Frames a second of training and of prediction of every detector, and peak memory.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/detectors.py [NETWORK …]
        [--preset openpcdet|paper|tiny] [--device cpu|cuda]

Batches of two ray-cast frames with 30 objects as the four 16-beam LiDARs of the paper's placement
*line* see them, cut to the network's range. Each network runs in a process of its own, which
compiles before it is measured; its figures are those of the fastest of `--steps` steps. Memory: on
a CPU what the process held at most, libraries included, on a GPU what torch allocated at most.
Prints a Markdown table.
"""

from __future__ import annotations

import multiprocessing
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from enum import StrEnum
from typing import Annotated

import numpy as np
import pandas as pd
import torch
import typer

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import collect
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLASSES, GEOMETRY
from training import NETWORKS, PRESETS, build_detector
from training.dataset import TrainingFrames, as_tensors
from training.detectors.detector import Detector

FRAMES, OBJECTS = 2, 30
SIZES = {"Car": (4.4, 1.9, 1.6), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.8, 0.6, 1.73)}
Preset = StrEnum("Preset", [(name, name) for name in PRESETS])  # type: ignore[misc]


class Device(StrEnum):
    cpu = "cpu"
    cuda = "cuda"


def main(
    networks: Annotated[list[str] | None, typer.Argument(help=f"of {', '.join(NETWORKS)}")] = None,
    preset: Preset = Preset("tiny"),
    device: Device = Device.cpu,
    steps: Annotated[int, typer.Option(min=1)] = 5,
) -> None:
    print(f"{preset}, {device}, torch {torch.__version__}\n")
    print("| network | parameters | points a frame | predict (frames/s) | peak (GB) "
          "| train (frames/s) | peak (GB) |")  # fmt: skip
    print("|---|---:|---:|---:|---:|---:|---:|")
    spawn = multiprocessing.get_context("spawn")  # a fork would inherit memory, and lacks CUDA
    for network in networks or NETWORKS:
        with ProcessPoolExecutor(1, mp_context=spawn) as pool:
            print(pool.submit(_row, network, str(preset), str(device), steps).result(), flush=True)


def _row(network: str, preset: str, device: str, steps: int) -> str:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    model = build_detector(network, CLASSES, preset)
    model.to(device)
    points, boxes, labels = _batch(model)
    optimizer = torch.optim.AdamW(model.parameters())

    def train() -> None:
        model.train()
        optimizer.zero_grad()
        model.loss(points, boxes, labels)["loss"].backward()
        optimizer.step()

    predicting = _fastest(lambda: model.predict(points), device, steps)
    training = _fastest(train, device, steps)
    parameters = sum(value.numel() for value in model.parameters())
    counts = np.mean([len(cloud) for cloud in points])
    cells = [
        f"{FRAMES / seconds:,.3g} | {peak / 1e9:.2f}" for seconds, peak in (predicting, training)
    ]
    return f"| {network} | {parameters:,} | {counts:,.0f} | {' | '.join(cells)} |"


def _fastest(step: Callable[[], object], device: str, steps: int) -> tuple[float, int]:
    """Seconds of the fastest step after one to compile in, and the bytes at the peak so far."""
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    best = np.inf
    for index in range(steps + 1):
        start = time.perf_counter()
        step()
        if device == "cuda":
            torch.cuda.synchronize()
        if index:
            best = min(best, time.perf_counter() - start)
    if device == "cuda":
        return best, torch.cuda.max_memory_allocated()
    return best, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _batch(model: Detector) -> tuple[list[torch.Tensor], list[torch.Tensor], list[torch.Tensor]]:
    """Points, boxes and labels of frames that fill the range of `model`."""
    low, high = np.array(model.point_range[:3]), np.array(model.point_range[3:])
    low[2], high[2] = low[2] + model.sensor_height, high[2] + model.sensor_height
    log = _traffic(low, high)
    lidar = replace(Lidar.paper(), range_noise=0.02, drop_off=0.05)
    placement = PAPER_PLACEMENTS["line"].with_lidar(lidar)
    clouds = collect(log, np.arange(FRAMES), placement, (*low.tolist(), *high.tolist()))
    frames = TrainingFrames(CLASSES, clouds, log.boxes, model.sensor_height, min_points=5)
    return as_tensors([frames[i] for i in range(FRAMES)])


def _traffic(low: np.ndarray, high: np.ndarray) -> BoxLog:
    """Objects anywhere on the ground of the region, but not on the vehicle."""
    random = np.random.default_rng(0)
    count = FRAMES * OBJECTS
    name = random.choice(CLASSES, count)
    size = np.array([SIZES[key] for key in name])
    place = random.uniform((max(low[0], 4), low[1]), high[:2], (count, 2))
    geometry = np.column_stack([place, size[:, 2] / 2, size, random.uniform(-np.pi, np.pi, count)])
    boxes = pd.DataFrame(geometry, columns=list(GEOMETRY))
    frame = np.repeat(np.arange(FRAMES), OBJECTS)
    for column, value in (("scene", "road"), ("frame", frame), ("timestamp_s", 0.0),
                          ("object_id", np.arange(count)), ("class", name)):  # fmt: skip
        boxes[column] = value
    frames = pd.DataFrame({"scene": "road", "frame": np.arange(FRAMES), "timestamp_s": 0.0})
    return BoxLog(boxes, frames.assign(route=0, split="train"))


if __name__ == "__main__":
    typer.run(main)
