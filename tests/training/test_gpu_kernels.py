"""Every Triton kernel compiles for GPUs, with the types that the operations pass."""

import inspect
import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest
import torch

from lidarplace.clouds.collect import SimulatedClouds
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from tests.training import gpu_compilation
from tests.training.test_casting import CROP, log_of
from training.casting import cast_frames
from training.detectors.heads.anchor_targets import _assign_triton, anchor_rules
from training.detectors.heads.anchors import KITTI_ANCHORS, anchor_grid
from training.ops import ball_query, gpu, interpolation, points_in_boxes, voxel_query
from training.ops.gpu.grouping import means_by_cell, points_by_cell
from training.ops.gpu.rotated_iou import iou_3d, unsuppressed
from training.ops.gpu.sparse_conv import convolve, weight_gradient
from training.ops.sampling import _furthest_triton
from training.ops.sparse_rules import Windows, _keys, _reached_triton, _tables_triton

TYPES = {
    torch.float32: "fp32", torch.float64: "fp64", torch.float16: "fp16", torch.bfloat16: "bf16",
    torch.bool: "i1", torch.int32: "i32", torch.int64: "i64", torch.uint8: "u8",
}  # fmt: skip


def run_all(dtype):
    """Run each operation that has a kernel once."""
    xyz = torch.rand(40, 3).to(dtype)
    _furthest_triton(xyz, [30, 10], 4)
    for by_cell in (means_by_cell, points_by_cell):
        corners = [0.0, 0.0, 0.0], [0.5, 0.5, 0.5]
        by_cell([torch.rand(9, 4)], torch.device("cpu"), corners, (2, 2, 2), (1 << 62, 1 << 62))
    sites = torch.tensor([[0, 0, 0, 0], [0, 1, 2, 2]])
    windows = Windows((2, 3, 3), (1, 3, 1), (1, 2, 1), (0, 0, 0))
    starts = _reached_triton(sites, windows)
    table, _ = _tables_triton(_keys(sites, windows.extents), starts, windows)
    for kind in {dtype, torch.float16, torch.bfloat16}:
        features = xyz[:2].to(kind)
        convolve(features, torch.zeros(5, 3, 3, dtype=kind), table)
        weight_gradient(features, torch.zeros(len(starts), 5, dtype=kind), table)
    boxes = torch.rand(2, 6, 7).to(dtype)
    iou_3d(boxes, boxes)
    unsuppressed(boxes, torch.tensor([6, 3]), 0.1, 4)
    anchors = anchor_grid([KITTI_ANCHORS["Car"]], (0, 0, 0, 4, 4, 4), (2, 2), centred=True)
    rules = anchor_rules([KITTI_ANCHORS["Car"]])
    _assign_triton(anchors, rules, list(boxes), torch.ones(2, 6, dtype=torch.int64))
    frames = xyz, torch.tensor([30, 10])
    ball_query._query_triton(0.1, 4, *frames, *frames)
    interpolation._nearest_triton(*frames, *frames)
    points_in_boxes._first_box_triton(xyz, [30, 10], 2 * [torch.rand(2, 7).to(dtype)])
    points_in_boxes._first_points_triton(xyz, [30, 10], torch.rand(2, 2, 7).to(dtype), 4)
    cells = torch.cartesian_prod(torch.arange(5), torch.arange(2), torch.arange(2), torch.arange(2))
    voxels = voxel_query.OccupiedVoxels(xyz, cells, (2, 2, 2))
    voxel_query._query_triton((1, 1, 1), 0.1, 4, voxels, xyz, cells)
    rig = Placement("one", [Mount(z=2.0)], Lidar((-0.2,), azimuth_steps=4))
    cast_frames(SimulatedClouds(log_of(1, 0), [0], rig, CROP), [0], torch.device("cpu"))


def type_of(value):
    if isinstance(value, torch.Tensor):
        return "*" + TYPES[value.dtype]
    if isinstance(value, float):
        return "fp32"
    return "i32" if abs(value) < 2**31 else "i64"


@pytest.fixture
def launches(monkeypatch):
    """What is launched, as `gpu_compilation` reads it, and the modules of kernels."""
    items = []

    def recorded(launch):
        def launch_and_record(kernel, programs, *arguments, warps=4, **constants):
            names = inspect.getfullargspec(kernel.fn).args
            signature = dict(zip(names, map(type_of, arguments), strict=False))
            signature |= dict.fromkeys(constants, "constexpr")
            item = {"module": kernel.fn.__module__, "kernel": kernel.fn.__name__, "warps": warps}
            items.append(item | {"signature": signature, "constants": constants})
            launch(kernel, programs, *arguments, warps=warps, **constants)

        return launch_and_record

    for module in modules():
        if hasattr(module, "launch") and module.__name__ != "training.ops.gpu.launch":
            monkeypatch.setattr(module, "launch", recorded(module.launch))
    return items


def modules():
    return [import_module(f"{gpu.__name__}.{info.name}") for info in iter_modules(gpu.__path__)]


def test_kernels_compile(launches):
    for dtype in (torch.float32, torch.float64):
        run_all(dtype)
    kernels = {(item["module"], item["kernel"]) for item in launches}
    files = {Path(module.__file__).stem for module in modules()} - {"launch", "bisection"}
    assert {module.rpartition(".")[2] for module, _ in kernels} == files
    unique = {json.dumps(item, sort_keys=True): item for item in launches}.values()
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    done = subprocess.run(
        [sys.executable, gpu_compilation.__file__],
        input=json.dumps(list(unique)),
        text=True,
        capture_output=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == len(unique) * len(gpu_compilation.CAPABILITIES)
