"""Milliseconds, memory and launches of the networks' steps, and those of OpenPCDet's."""

from __future__ import annotations

import os
import resource
import statistics
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import collect
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLASSES, GEOMETRY
from training import build_detector
from training.dataset import TrainingFrames, as_tensors
from training.detectors.detector import Detector
from training.optimisation import Batch, Optimisation
from training.settings import TrainingSettings

OBJECTS, STEPS, WARM_UP = 30, 10, 3
SIZES = {"Car": (4.4, 1.9, 1.6), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.8, 0.6, 1.73)}
CONFIGURATIONS = {"pointpillars": "pointpillar", "voxel_rcnn": "voxel_rcnn_car"}  # of OpenPCDet
WAITS = ("cudaStreamSynchronize", "cudaDeviceSynchronize", "cudaEventSynchronize", "cudaMemcpy")


def measure(network: str, preset: str, device: str, sizes: list[int], most_s: float) -> list[dict]:
    """Measure ours with each number of frames a step: a row each. The frames are on the device."""
    torch.set_num_threads(1)
    return [measure_ours(network, preset, device, size, most_s) for size in sizes]


def measure_ours(network: str, preset: str, device: str, frames: int, most_s: float) -> dict:
    """Measure steps of our network."""
    torch.manual_seed(0)
    model = build_detector(network, CLASSES, preset).to(device)
    points, boxes, labels = batch_of(model, frames)
    batch = [cloud.to(device) for cloud in points], boxes, labels
    steps: dict[str, Callable[[], object]] = {"predict": lambda: model.predict(batch[0])}
    for name, half in (("train", False), ("train, 16 bits", "everywhere")):
        settings = TrainingSettings(mixed_precision=half, lr=1e-4)
        steps[name] = stepping(Optimisation(model, settings, steps=10**6), model, batch)
    parameters = sum(value.numel() for value in model.parameters())
    count = float(np.mean([len(cloud) for cloud in points]))
    row = {"network": network, "frames": frames, "parameters": parameters, "points": count}
    return row | measured(steps, device, frames, most_s)


def stepping(optimisation: Optimisation, model: Detector, batch: Batch) -> Callable[[], object]:
    """Make a function of a training step."""
    return lambda: (model.train(), optimisation.step(batch))


def measured(
    steps: dict[str, Callable[[], object]], device: str, frames: int, most_s: float
) -> dict[str, Any]:
    """Return ms a frame and peak GB of each step, and a profile of the 32-bit ones."""
    row: dict[str, Any] = {}
    for name, step in steps.items():
        if device == "cuda":
            torch.cuda.reset_peak_memory_stats()
        seconds = timed(step, device, most_s)
        row[f"{name} (ms)"] = 1e3 * seconds / frames
        row[f"{name} (GB)"] = peak_bytes(device) / 1e9
        if "16" not in name:
            row[f"{name}: profile"] = profiled(step, device, seconds)
    return row


def timed(step: Callable[[], object], device: str, most_s: float) -> float:
    """Return the median seconds of some steps after the first ones, which compile."""
    seconds: list[float] = []
    for index in range(WARM_UP + STEPS):
        start = time.perf_counter()
        step()
        synchronize(device)
        seconds.append(time.perf_counter() - start)
        if index > WARM_UP and sum(seconds[WARM_UP:]) > most_s:
            break
    return statistics.median(seconds[WARM_UP:])


def synchronize(device: str) -> None:
    """Wait for what was launched."""
    if device == "cuda":
        torch.cuda.synchronize()


def peak_bytes(device: str) -> int:
    """Return what torch allocated at most on a GPU; on a CPU what the process held at most."""
    if device == "cuda":
        return torch.cuda.max_memory_allocated()
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def profiled(step: Callable[[], object], device: str, seconds: float) -> dict[str, Any]:
    """Count launches and waits of a step, and list its ten dearest kernels, on a CPU operations."""
    from torch.profiler import ProfilerActivity, profile

    gpu = device == "cuda"
    activities = [ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if gpu else [])]
    with profile(activities=activities) as profiler:
        step()
        synchronize(device)
    events = profiler.key_averages()
    kernels = [
        e
        for e in events
        if not gpu or (str(e.device_type).endswith("CUDA") and not e.is_user_annotation)
    ]
    cost = {e.key: (e.self_device_time_total if gpu else e.self_cpu_time_total) for e in kernels}
    dearest = sorted(kernels, key=lambda event: -cost[event.key])[:10]
    launches = (e.count for e in events if e.key.startswith(("cudaLaunch", "cuLaunch")))
    return {
        "launches": sum(launches) if gpu else None,
        "waits": sum(e.count for e in events if e.key in WAITS) if gpu else None,
        "busy": sum(cost.values()) / 1e6 / seconds if gpu else None,
        "dearest": [(f"`{e.key[:90]}`", cost[e.key] / 1e3, e.count) for e in dearest],
    }


def batch_of(model: Detector, frames: int) -> Batch:
    """Points, boxes and labels of frames that fill the range of `model`, ray-cast under *line*."""
    low, high = np.array(model.point_range[:3]), np.array(model.point_range[3:])
    low[2], high[2] = low[2] + model.sensor_height, high[2] + model.sensor_height
    log = traffic(low, high, frames)
    lidar = replace(Lidar.paper(), range_noise=0.02, drop_off=0.05)
    placement = PAPER_PLACEMENTS["line"].with_lidar(lidar)
    clouds = collect(log, np.arange(frames), placement, (*low.tolist(), *high.tolist()))
    training = TrainingFrames(CLASSES, clouds, log.boxes, model.sensor_height, min_points=5)
    return as_tensors([training[i] for i in range(frames)])


def traffic(low: np.ndarray, high: np.ndarray, frames: int) -> BoxLog:
    """Objects anywhere on the ground of the region, but not on the vehicle."""
    random = np.random.default_rng(0)
    count = frames * OBJECTS
    name = random.choice(CLASSES, count)
    size = np.array([SIZES[key] for key in name])
    place = random.uniform((max(low[0], 4), low[1]), high[:2], (count, 2))
    geometry = np.column_stack([place, size[:, 2] / 2, size, random.uniform(-np.pi, np.pi, count)])
    frame = np.repeat(np.arange(frames), OBJECTS)
    boxes = pd.DataFrame(geometry, columns=list(GEOMETRY)).assign(
        scene="road", frame=frame, timestamp_s=0.0, object_id=np.arange(count)
    )
    boxes["class"] = name
    table = pd.DataFrame({"scene": "road", "frame": np.arange(frames), "timestamp_s": 0.0})
    return BoxLog(boxes, table.assign(route=0, split="train"))


def measure_openpcdet(network: str, sizes: list[int], most_s: float) -> list[dict]:
    """Measure OpenPCDet's network on the same frames; its voxels are made before the clock runs.

    Needs a checkout that `python setup.py develop` installed, with its folder `tools`."""
    import pcdet
    from easydict import EasyDict
    from pcdet.config import cfg_from_yaml_file
    from pcdet.datasets.dataset import DatasetTemplate
    from pcdet.models import build_network, load_data_to_gpu

    os.chdir(Path(pcdet.__file__).parents[1] / "tools")
    name = CONFIGURATIONS.get(network, network)
    settings = cfg_from_yaml_file(f"cfgs/kitti_models/{name}.yaml", EasyDict())
    classes = list(settings.CLASS_NAMES)

    def loaded(frames: Batch, mode: str) -> tuple[Any, dict]:
        """A data set that gives the limits of voxels of a mode, and its batch."""
        dataset = DatasetTemplate(settings.DATA_CONFIG, classes, training=False, root_path=Path())
        dataset.data_processor.mode = mode
        names = np.array(CLASSES)
        items = [
            {"points": p.numpy(), "gt_boxes": b.numpy(), "gt_names": names[label.numpy() - 1]}
            for p, b, label in zip(*frames, strict=True)
        ]
        batch = dataset.collate_batch([dataset.prepare_data(item) for item in items])
        load_data_to_gpu(batch)
        return dataset, batch

    rows = []
    for size in sizes:
        frames = batch_of(build_detector(network, CLASSES, "openpcdet"), size)
        (dataset, batch), (_, batch_of_training) = (loaded(frames, m) for m in ("test", "train"))
        model = build_network(settings.MODEL, len(classes), dataset).cuda()
        optimizer = torch.optim.AdamW(model.parameters(), lr=1e-4)

        def predict(model: Any = model, batch: Any = batch) -> None:
            with torch.no_grad():
                model.eval()(dict(batch))

        def train(
            model: Any = model, batch: Any = batch_of_training, optimizer: Any = optimizer
        ) -> None:
            optimizer.zero_grad()
            model.train()(dict(batch))[0]["loss"].backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), 10)
            optimizer.step()

        row = {"network": network, "frames": size}
        with suppress(torch.OutOfMemoryError):
            row |= measured({"predict": predict, "train": train}, "cuda", size, most_s)
        rows.append(row)
    return rows
