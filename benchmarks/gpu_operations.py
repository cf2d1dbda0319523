"""Milliseconds of each operation on points, voxels and boxes, by the CPU's and the GPU's kernel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
from gpu_networks import batch_of, timed
from torch import Tensor

from lidarplace.logs.boxes import CLASSES
from training import build_detector
from training.detectors.backbones.voxels import voxelise
from training.detectors.heads.pointrcnn_head import pool_points
from training.ops.ball_query import ball_query
from training.ops.box_overlap import iou_3d
from training.ops.grouping import group
from training.ops.interpolation import three_nn
from training.ops.nms import nms
from training.ops.points_in_boxes import box_of_points
from training.ops.sampling import furthest_point_sample
from training.ops.sparse_conv import SparseTensor
from training.ops.voxel_query import OccupiedVoxels, voxel_query

CAR = (3.9, 1.6, 1.56)
Operation = Callable[[], object]


def measure(device: str, preset: str, most_s: float) -> list[dict]:
    """Return a row for each operation: its ms on a CPU core, and on the GPU."""
    torch.set_num_threads(1)
    seconds: dict[str, dict[str, float]] = {}
    for place in dict.fromkeys(["cpu", device]):
        small = preset == "tiny"
        for name, operation in operations(torch.device(place), preset, 0.1 if small else 1):
            seconds.setdefault(name, {})[place] = 1e3 * timed(operation, place, most_s)
    return [{"operation": name, **by_place} for name, by_place in seconds.items()]


def operations(device: torch.device, preset: str, share: float) -> Iterator[tuple[str, Operation]]:
    """List operations with the sizes of a KITTI frame, or with a share of them."""
    random = np.random.default_rng(0)
    yield from of_points(random, device, int(16_384 * share), int(2048 * share))
    yield from of_voxels(random, device, int(16_000 * share), int(27_648 * share))
    yield from of_boxes(random, device, int(9000 * share))
    yield from of_networks(device, preset)


def of_points(
    random: np.random.Generator, device: torch.device, count: int, samples: int
) -> Iterator[tuple[str, Operation]]:
    xyz = random.uniform((0, -40, -3), (70, 40, 1), (count, 3))
    cloud = torch.from_numpy(xyz.astype(np.float32)).to(device)
    counts, chosen = torch.tensor([count]).to(device), torch.tensor([samples]).to(device)
    of = f"{samples:,} of {count:,}"
    yield f"furthest {of}", partial(furthest_point_sample, cloud, [count], samples)
    centres = cloud[furthest_point_sample(cloud, [count], samples)[0]]
    for ball in ((0.8, 16), (2.4, 32)):
        name = f"ball query {of}, {ball[0]} m, {ball[1]} samples"
        yield name, partial(ball_query, *ball, cloud, counts, centres, chosen)
    yield f"three nearest, {of}", partial(three_nn, cloud, counts, centres, chosen)
    rois = scattered(random, 128, device)
    features = torch.ones(count, 128, device=device)
    yield f"box of 128 of {count:,} points", partial(box_of_points, cloud, [count], [rois])
    pooled = cloud, [count], features, rois[None], 512, 1.0
    yield "512 points of 128 boxes", partial(pool_points, *pooled)
    idx, _ = ball_query(2.4, 32, cloud, counts, centres, chosen)
    yield f"group {samples:,} × 32 × 128, both ways", partial(both_ways, features, idx)


def both_ways(features: Tensor, idx: Tensor) -> None:
    group(features.requires_grad_(), idx).sum().backward()


def of_voxels(
    random: np.random.Generator, device: torch.device, count: int, queries: int
) -> Iterator[tuple[str, Operation]]:
    shape, size = (21, 800, 704), torch.tensor([0.1, 0.1, 0.2], device=device)
    cells = np.unique(random.integers((0, 0, 300, 250), (2, *shape), (count, 4)), axis=0)
    coordinates = torch.from_numpy(cells).to(device)
    new = random.integers((0, 0, 300, 250), (2, *shape), (queries, 4))
    places = torch.from_numpy(new).to(device)
    xyz, new_xyz = coordinates[:, [3, 2, 1]] * size, places[:, [3, 2, 1]] * size
    voxels = OccupiedVoxels(xyz, coordinates, shape)
    name = f"voxel query {queries:,} of {count:,}, 9 × 9 × 9"
    yield name, partial(voxel_query, (4, 4, 4), 0.4, 16, voxels, new_xyz, places)


def of_boxes(
    random: np.random.Generator, device: torch.device, count: int
) -> Iterator[tuple[str, Operation]]:
    sparse, crowd = scattered(random, 4096, device), proposals(random, count, device)
    scores = torch.from_numpy(random.random(max(count, 4096), np.float32)).to(device)
    yield "NMS of 4,096 boxes at 0.01", partial(nms, sparse[None], scores[None, :4096], 0.01)
    for post in (count, 512):
        name = f"NMS of {count:,} proposals at 0.8, up to {post} kept"
        yield name, partial(nms, crowd[None], scores[None, :count], 0.8, count, post)
    yield (
        "IoU of 512 proposals with 40 boxes",
        partial(iou_3d, crowd[None, :512], crowd[None, 512:552]),
    )


def of_networks(device: torch.device, preset: str) -> Iterator[tuple[str, Operation]]:
    """Voxels, pillars, the sparse backbone and anchor targets of a batch of two frames."""
    model = build_detector("second", CLASSES, preset).to(device).train()
    points, boxes, labels = batch_of(model, 2)
    points = [cloud.to(device) for cloud in points]
    objects = model.objects(boxes, labels)
    make = partial(voxelise, points, model.grid, True, device)
    voxels = make()
    few = voxels.features[:16_000], voxels.coordinates[:16_000], voxels.shape, voxels.frames
    name = f"sparse backbone, {len(few[0]):,} voxels"
    yield "voxels of 2 frames", make
    yield f"{name}, forward and backward", lambda: backbone(model, SparseTensor(*few))
    yield "anchor targets of 2 frames", partial(model.dense_head.targets, *objects)
    pillars = build_detector("pointpillars", CLASSES, preset).to(device).train()
    yield "image of pillars of 2 frames", partial(pillars._pillars, points)


def backbone(model: Any, voxels: SparseTensor) -> None:
    """Run the sparse backbone of a network, with the tables of its convolutions, both ways."""
    model.backbone_3d(voxels)["encoded"].features.square().sum().backward()


def scattered(random: np.random.Generator, count: int, device: torch.device) -> Tensor:
    centre = random.uniform((0, -40, -2), (70, 40, 0), (count, 3))
    yaw = random.uniform(-np.pi, np.pi, (count, 1))
    boxes = np.hstack([centre, np.tile(CAR, (count, 1)), yaw])
    return torch.from_numpy(boxes.astype(np.float32)).to(device)


def proposals(random: np.random.Generator, count: int, device: torch.device) -> Tensor:
    """Boxes spread around 30 cars, as a first stage proposes them."""
    cars = scattered(random, 30, device)[torch.from_numpy(random.integers(0, 30, count))]
    spread = random.normal(0, (0.5, 0.5, 0.1, 0.15, 0.08, 0.05, 0.15), (count, 7))
    return cars + torch.from_numpy(spread.astype(np.float32)).to(device)
