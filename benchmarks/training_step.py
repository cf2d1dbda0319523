"""Seconds of one training step of every detector preset, batch 2, on one CPU core.

OMP_NUM_THREADS=1 python benchmarks/training_step.py
"""

from __future__ import annotations

import time

import numpy as np
import torch

from training import build_detector

POINTS, BOXES, STEPS = 17_000, 8, 10


def main() -> None:
    """Print milliseconds of the fastest of some steps."""
    torch.set_num_threads(1)
    random = np.random.default_rng(0)
    for name in ("pointpillars_tiny", "pointpillars"):
        model = build_detector(name, ["Car", "Cyclist", "Pedestrian"])
        low, high = np.array(model.point_range[:3]), np.array(model.point_range[3:])
        points = [_points(random, low, high) for _ in range(2)]
        boxes = [_boxes(random, low, high) for _ in range(2)]
        labels = [torch.from_numpy(random.integers(1, 4, BOXES)) for _ in range(2)]
        optimizer = torch.optim.AdamW(model.parameters())
        seconds = []
        for _ in range(STEPS if name.endswith("tiny") else 2):
            start = time.perf_counter()
            optimizer.zero_grad()
            model.loss(points, boxes, labels)["loss"].backward()
            optimizer.step()
            seconds.append(time.perf_counter() - start)
        print(f"{name:18} {1000 * min(seconds):7.0f} ms a step of 2 frames, {POINTS} points each")


def _points(random: np.random.Generator, low: np.ndarray, high: np.ndarray) -> torch.Tensor:
    xyz = random.uniform(low, high, (POINTS, 3))
    return torch.from_numpy(np.column_stack([xyz, random.random(POINTS)]).astype(np.float32))


def _boxes(random: np.random.Generator, low: np.ndarray, high: np.ndarray) -> torch.Tensor:
    centre = random.uniform(low, high, (BOXES, 3))
    size = np.tile([4.2, 1.8, 1.6], (BOXES, 1))
    yaw = random.uniform(-np.pi, np.pi, (BOXES, 1))
    return torch.from_numpy(np.hstack([centre, size, yaw]).astype(np.float32))


if __name__ == "__main__":
    main()
