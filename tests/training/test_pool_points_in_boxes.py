"""Points in boxes and RoI-point pooling: OpenPCDet's kernels, another test of insideness.

tests/data/training_ops.npz: see test_point_ops.py.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from training.detectors.heads.pointrcnn_head import pool_points as pool
from training.ops import points_in_boxes
from training.ops.points_in_boxes import (
    _first_box_numba,
    _first_box_triton,
    _first_points_numba,
    _first_points_triton,
    box_of_points,
)

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")
POINTS = torch.from_numpy(DATA["points"])
FIRST_BOX = (_first_box_numba, _first_box_triton)
FIRST_POINTS = (_first_points_numba, _first_points_triton)


@pytest.fixture(params=FIRST_POINTS)
def _both_paths(request, monkeypatch):
    """Pooling with the kernel for CPUs, and with the one for GPUs."""
    monkeypatch.setattr(points_in_boxes, "_first_points_numba", request.param)


def pool_in_frame(points, features, boxes, samples, extra):
    return pool(points, [len(points)], features, boxes[None], samples, extra)


def inside(points, boxes):
    """Test by complex numbers in float64: (M, N) bool, and likewise if the answer is clear."""
    points, boxes = np.float64(points), np.float64(boxes)
    turned = (points[:, 0] + 1j * points[:, 1] - (boxes[:, :1] + 1j * boxes[:, 1:2])) * np.exp(
        -1j * boxes[:, 6:]
    )
    local = np.stack([turned.real, turned.imag, points[:, 2] - boxes[:, 2:3]], axis=2)
    outside = (abs(local) - boxes[:, None, 3:6] / 2).max(axis=2)
    return outside < 0, abs(outside) > 1e-4


@pytest.mark.usefixtures("last_bits", "large_blocks")
@pytest.mark.parametrize("search", FIRST_BOX)
def test_box_of_points_agrees_with_openpcdet(search):
    first = search(POINTS, [len(POINTS)], [torch.from_numpy(DATA["pib_boxes"])])
    assert torch.equal(first, torch.from_numpy(DATA["pib_box"].astype(np.int64)))
    assert len(first.unique()) > 5


@pytest.mark.usefixtures("last_bits", "large_blocks", "_both_paths")
def test_pooling_agrees_with_openpcdet():
    boxes = torch.from_numpy(DATA["roi_boxes"])
    pooled, empty = pool_in_frame(POINTS, torch.from_numpy(DATA["roi_features"]), boxes, 64, 0.0)
    assert torch.equal(pooled, torch.from_numpy(DATA["roi_pooled"]))
    assert torch.equal(empty, torch.from_numpy(DATA["roi_empty"]))
    sums = torch.from_numpy(DATA["roi1_feature_sum"])[:, None]
    pooled, empty = pool_in_frame(POINTS, sums, boxes, 64, 1.0)
    assert pooled.sum(dim=2).numpy() == pytest.approx(DATA["roi1_xyz_and_feature_sum"], abs=1e-5)
    assert torch.equal(empty, torch.from_numpy(DATA["roi1_empty"]))


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(0, 80), st.integers(0, 6), st.integers(1, 20))
def test_against_complex_numbers(seed, count, boxes, samples):
    random = np.random.default_rng(seed)
    points = random.uniform(-4, 4, (count, 3)).astype(np.float32)
    rois = np.hstack(
        [random.uniform(-3, 3, (boxes, 3)), random.uniform(0.1, 5, (boxes, 3)),
         random.uniform(-7, 7, (boxes, 1))]
    ).astype(np.float32)  # fmt: skip
    within, clear = inside(points, rois)
    points, within = points[clear.all(axis=0)], within[:, clear.all(axis=0)]
    expected = np.where(within.any(axis=0), within.argmax(axis=0), -1) if boxes else None
    for search in FIRST_BOX:
        first = search(torch.from_numpy(points), [len(points)], [torch.from_numpy(rois)])
        assert first.tolist() == ([-1] * len(points) if expected is None else expected.tolist())
    rows = torch.arange(len(points), dtype=torch.float32)[:, None]
    pooled, empty = pool_in_frame(
        torch.from_numpy(points), rows, torch.from_numpy(rois), samples, 0.0
    )
    assert empty.tolist() == (~within.any(axis=1)).tolist()
    for pooled_rows, hits in zip(pooled[:, :, 3].tolist(), within, strict=True):
        rows = np.flatnonzero(hits)[:samples]
        assert pooled_rows == (np.resize(rows, samples).tolist() if len(rows) else [0] * samples)


@pytest.mark.usefixtures("last_bits")
@pytest.mark.parametrize("search", FIRST_BOX)
def test_borders(search):
    box = torch.tensor([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, math.pi / 2], [1.0, 2.0, 3.0, 9, 9, 9, 0]])
    # The length lies along y; top and bottom belong to the box, and so does a hair at the sides.
    points = torch.tensor(
        [[1.0, 4.0, 3.0], [1.0, 4.001, 3.0], [2.0, 2.0, 3.5], [2.001, 2.0, 3.0], [1.0, 2.0, 3.501],
         [1.0, 2.0, 7.6]]
    )  # fmt: skip
    assert search(points, [6], [box]).tolist() == [0, 1, 0, 1, 1, -1]


def test_nothing_to_look_at():
    some, none, features = torch.zeros(4, 3), torch.zeros(0, 3), torch.ones(4, 2)
    box = torch.tensor([[0.0, 0, 0, 1, 1, 1, 0], [5.0, 0, 0, 1, 1, 1, 0]])
    assert box_of_points(none, [0], [box]).tolist() == []
    assert box_of_points(some, [4], [box[:0]]).tolist() == [-1] * 4
    assert box_of_points(some, [4], [box.double()]).tolist() == [0] * 4
    pooled, empty = pool_in_frame(none, features[:0], box, 3, 0.2)
    assert torch.equal(pooled, torch.zeros(2, 3, 5))
    assert empty.all()
    pooled, empty = pool_in_frame(some, features, box[:0], 3, 0.2)
    assert pooled.shape == (0, 3, 5)
    pooled, empty = pool_in_frame(some, features, box, 6, 0.2)
    assert torch.equal(pooled[0], torch.tensor([0.0, 0, 0, 1, 1]).expand(6, 5))
    assert torch.equal(pooled[1], torch.zeros(6, 5))
    assert empty.tolist() == [False, True]


def test_pooling_keeps_boxes_and_passes_gradients():
    random = np.random.default_rng(1)
    points = torch.from_numpy(random.uniform(-2, 2, (30, 3)))
    boxes = torch.tensor(
        [[0.0, 0, 0, 2, 2, 2, 0.3], [1, 1, 0, 2, 1, 2, 2.0], [9, 9, 9, 1, 1, 1, 0]]
    )
    before = boxes.clone()
    features = torch.from_numpy(random.normal(size=(30, 2))).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda rows: pool_in_frame(points, rows, boxes, 5, 0.5)[0], (features,)
    )
    assert torch.equal(boxes, before)
    half = pool_in_frame(points.float(), features.detach().bfloat16(), boxes, 5, 0.5)[0]
    assert torch.equal(
        half[..., :3], pool_in_frame(points.float(), features, boxes, 5, 0.5)[0][..., :3].float()
    )
