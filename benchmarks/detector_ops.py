"""Milliseconds of the detectors' operations on points and boxes, on one CPU core or on a GPU.

OMP_NUM_THREADS=1 python benchmarks/detector_ops.py [cpu | cuda]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from training.detectors.heads.pointrcnn_head import pool_points
from training.ops.ball_query import ball_query
from training.ops.box_overlap import iou_3d
from training.ops.grouping import group
from training.ops.interpolation import three_nn
from training.ops.nms import nms
from training.ops.points_in_boxes import box_of_points
from training.ops.sampling import furthest_point_sample
from training.ops.voxel_query import OccupiedVoxels, voxel_query

RUNS = 7
CAR = (3.9, 1.6, 1.56)


def main() -> None:
    """Print the fastest of some runs of every operation."""
    torch.set_num_threads(1)
    device = torch.device(sys.argv[1] if len(sys.argv) > 1 else "cpu")
    random = np.random.default_rng(0)
    _points(random, device)
    _voxels(random, device)
    _boxes(random, device)


def _points(random: np.random.Generator, device: torch.device) -> None:
    for count in (16_384, 1_000_000):
        print(f"{count} points")
        xyz = random.uniform((0, -40, -3), (70, 40, 1), (count, 3))
        cloud = torch.from_numpy(xyz.astype(np.float32)).to(device)
        counts, chosen = torch.tensor([count]).to(device), torch.tensor([2048]).to(device)
        _report("furthest 2048", furthest_point_sample, cloud, [count], 2048)
        centres = cloud[furthest_point_sample(cloud, [count], 2048)[0]]
        for ball in ((0.8, 16), (2.4, 32)):
            name = f"ball query 2048, {ball[0]} m, {ball[1]} samples"
            _report(name, ball_query, *ball, cloud, counts, centres, chosen)
        _report("three nearest of 2048", three_nn, cloud, counts, centres, chosen)
        rois = _scattered(random, 128, device)
        features = torch.ones(count, 128, device=device)
        _report("box of 128 of every point", box_of_points, cloud, [count], [rois])
        pooled = cloud, [count], features, rois[None], 512, 1.0
        _report("512 points of each of 128 boxes", pool_points, *pooled)
        idx, _ = ball_query(2.4, 32, cloud, counts, centres, chosen)
        _report("group 2048 × 32 × 128, both ways", _both_ways, features.requires_grad_(), idx)


def _both_ways(features: Tensor, idx: Tensor) -> None:
    group(features, idx).sum().backward()


def _voxels(random: np.random.Generator, device: torch.device) -> None:
    shape = (21, 800, 704)
    size = torch.tensor([0.1, 0.1, 0.2], device=device)
    cells = np.unique(random.integers((0, 0, 300, 250), (2, *shape), (16_000, 4)), axis=0)
    coordinates = torch.from_numpy(cells).to(device)
    new = torch.from_numpy(random.integers((0, 0, 300, 250), (2, *shape), (27_648, 4))).to(device)
    xyz, new_xyz = coordinates[:, [3, 2, 1]] * size, new[:, [3, 2, 1]] * size
    name = "voxel query 27648 of 16000, 9 × 9 × 9"
    voxels = OccupiedVoxels(xyz, coordinates, shape)
    _report(name, voxel_query, (4, 4, 4), 0.4, 16, voxels, new_xyz, new)


def _boxes(random: np.random.Generator, device: torch.device) -> None:
    sparse, crowd = _scattered(random, 4096, device), _proposals(random, 9000, device)
    scores = torch.rand(9000, device=device)
    _report("NMS of 4096 boxes at 0.01", nms, sparse, scores[:4096], 0.01)
    for post in (9000, 512):
        name = f"NMS of 9000 proposals at 0.8, up to {post} kept"
        _report(name, nms, crowd, scores, 0.8, 9000, post)
    _report("IoU of 512 proposals with 40 boxes", iou_3d, crowd[:512], crowd[512:552])


def _scattered(random: np.random.Generator, count: int, device: torch.device) -> Tensor:
    centre = random.uniform((0, -40, -2), (70, 40, 0), (count, 3))
    yaw = random.uniform(-np.pi, np.pi, (count, 1))
    boxes = np.hstack([centre, np.tile(CAR, (count, 1)), yaw])
    return torch.from_numpy(boxes.astype(np.float32)).to(device)


def _proposals(random: np.random.Generator, count: int, device: torch.device) -> Tensor:
    """Boxes spread around 30 cars, as a first stage proposes them."""
    cars = _scattered(random, 30, device)[torch.from_numpy(random.integers(0, 30, count))]
    spread = random.normal(0, (0.5, 0.5, 0.1, 0.15, 0.08, 0.05, 0.15), (count, 7))
    return cars + torch.from_numpy(spread.astype(np.float32)).to(device)


def _report(name: str, operation: Callable[..., object], *arguments: object) -> None:
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        operation(*arguments)
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - start)
    print(f"  {name:48}{1000 * min(seconds):9.1f} ms")


if __name__ == "__main__":
    main()
