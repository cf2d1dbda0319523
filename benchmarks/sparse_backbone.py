"""Milliseconds of SECOND's stages, and of its sparse backbone on 16,000 voxels, on one CPU core.

OMP_NUM_THREADS=1 python benchmarks/sparse_backbone.py

The clouds are the two made-up frames of the tests. Times are of the processor, fastest of some
runs, so that other programs count little.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.detectors import second
from training.detectors.backbones.voxels import voxelise
from training.ops.sparse_conv import SparseTensor

POINTS = Path(__file__).parents[1] / "tests" / "data" / "openpcdet" / "points.npz"
VOXELS, RUNS = 16_000, 10


def main() -> None:
    """Print forward and backward time of every stage."""
    torch.set_num_threads(1)
    frames = np.load(POINTS)
    clouds = [torch.from_numpy(frames[f"frame_{i}"]) for i in range(2)]
    model = second.build(["Car", "Pedestrian", "Cyclist"], "openpcdet", None, ()).train()
    device = torch.device("cpu")
    voxels = voxelise(clouds, model.grid, True, device)
    some = _first(voxels, VOXELS)

    time_of_voxels = _milliseconds(lambda: voxelise(clouds, model.grid, True, device))
    print(f"voxels of 2 frames      {time_of_voxels:7.1f}")
    _print("sparse backbone, 16,000", lambda: _backbone(model, some), RUNS)
    bev = model.backbone_3d(_first(voxels, len(voxels.features)))["encoded"].bev().detach()
    _print("2D backbone, 2 frames", lambda: model.backbone_2d(bev), 2)
    image = model.backbone_2d(bev).detach()
    _print("dense head, 2 frames", lambda: model.dense_head(image).logits, 2)
    model.eval()
    with torch.no_grad():
        time_of_evaluation = _milliseconds(lambda: model.backbone_2d(bev), 2)
    print(f"2D backbone, evaluation {time_of_evaluation:7.1f}")


def _first(voxels: SparseTensor, count: int) -> SparseTensor:
    """The first voxels, without the tables that belong to all of them."""
    return SparseTensor(
        voxels.features[:count], voxels.coordinates[:count], voxels.shape, voxels.frames
    )


def _backbone(model: second.Second, voxels: SparseTensor) -> Tensor:
    return model.backbone_3d(_first(voxels, VOXELS))["encoded"].features


def _milliseconds(run: Callable[[], object], runs: int = RUNS) -> float:
    seconds = []
    for _ in range(runs):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return 1000 * min(seconds)


def _print(name: str, forward: Callable[[], Tensor], runs: int) -> None:
    times = []
    for _ in range(runs):
        start = time.process_time()
        loss = forward().square().sum()
        middle = time.process_time()
        loss.backward()
        times.append((middle - start, time.process_time() - middle))
    there, back = (1000 * min(column) for column in zip(*times, strict=True))
    print(f"{name:23} {there:7.1f} forward {back:7.1f} backward")


if __name__ == "__main__":
    main()
