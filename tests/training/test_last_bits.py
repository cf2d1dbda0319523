"""Decisions do not depend on the last bits of sines, exponentials and roots.

The comparisons of other files that use the fixture `last_bits` run under such changes too.
"""

import math

import numpy as np
import pytest
import torch

from tests.training.last_bits import LastBits
from training import build_detector
from training.detectors.backbones.point_sampling import NEAR, sample_points
from training.detectors.detector import Selection
from training.detectors.heads.anchor_head import HeadOutput
from training.detectors.heads.pointrcnn_head import pool_points
from training.detectors.heads.proposals import Proposals, Suppression
from training.detectors.heads.roi_box_coder import roi_grid
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.ops.interpolation import three_nn
from training.ops.points_in_boxes import MARGIN, _first_box_numba, _first_box_triton

ALL = Selection(score=0.1, nms=1.0, pre=10_000, post=10_000)
"""Whatever is likely enough, however much it overlaps."""


def neighbours(values, steps=4):
    """float32 numbers `values` (N,), each with those up to `steps` units around it, (N, 2S + 1)."""
    bits = torch.as_tensor(values, dtype=torch.float32)[:, None].view(torch.int32)
    return (bits + torch.arange(-steps, steps + 1, dtype=torch.int32)).view(torch.float32)


def border_logits():
    """Around the lowest score, where sigmoids are equal, and dense in between; shuffled."""
    edge = neighbours([math.log(0.1 / 0.9)], 40).flatten()
    logits = torch.cat([edge, torch.linspace(16, 18, 60), neighbours([0.3, 2.0], 50).flatten()])
    return logits[torch.randperm(len(logits), generator=torch.Generator().manual_seed(0))]


def one_stage_detections():
    model = build_detector("pointpillars_tiny", ["Car"])
    places = model.dense_head.anchors.reshape(1, -1, 7)
    logits = torch.full((1, places.shape[1], 1), -20.0)
    logits[0, : len(border_logits()), 0] = border_logits()
    head = model.dense_head
    for layer in (head.conv_box, head.conv_dir_cls):
        torch.nn.init.zeros_(layer.bias)
    raw = HeadOutput(logits, torch.zeros(1, places.shape[1], head.conv_box.in_channels))
    model.head_output = lambda _: raw
    return model.predict([], ALL)[0]["boxes"][:, :2]


def second_stage():
    logits = border_logits()
    boxes = torch.ones(1, len(logits), 7)
    boxes[0, :, 0] = torch.arange(len(logits))
    proposals = Proposals(boxes, logits[None], torch.ones(1, len(logits), dtype=torch.int64))
    limits = Suppression(nms=1.0, pre=100, post=100)
    head = RoiHead(RoiSettings(limits, limits))
    return head.detections(RoiOutput(logits[:, None], None), proposals, ALL)[0]


def two_stage_detections():
    return second_stage()["boxes"][:, 0]


def far_points():
    random = np.random.default_rng(0)
    rays = random.normal(size=(3000, 3))
    points = np.zeros((3000, 4), np.float32)
    points[:, :3] = NEAR * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return sample_points(torch.from_numpy(points), 2500, training=False)


def boxes_and_points_on_their_sides():
    random = np.random.default_rng(1)
    boxes = np.zeros((50, 7))
    boxes[:, :2], boxes[:, 3:6] = random.uniform(-30, 30, (50, 2)), random.uniform(1, 5, (50, 3))
    boxes[:, 6] = random.uniform(-4, 4, 50)
    boxes = boxes.astype(np.float32)
    reach = np.float64(boxes[:, 3]) / 2 + MARGIN
    across = random.uniform(-0.5, 0.5, (40, 50)) * boxes[:, 4]
    cos, sin = np.cos(np.float64(boxes[:, 6])), np.sin(np.float64(boxes[:, 6]))
    x, y = boxes[:, 0] + cos * reach - sin * across, boxes[:, 1] + sin * reach + cos * across
    points = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3).astype(np.float32)
    return torch.from_numpy(points), torch.from_numpy(boxes)


def box_of_points(search=_first_box_numba):
    points, boxes = boxes_and_points_on_their_sides()
    return search(points, [len(points)], [boxes])


def pooled_points():
    points, boxes = boxes_and_points_on_their_sides()
    return pool_points(points, [len(points)], points, boxes[None], 64, 0.0)[0].flatten(0, 1)


def places_in_rois():
    return roi_grid(boxes_and_points_on_their_sides()[1], 6)


def three_nearest():
    grid, counts = torch.cartesian_prod(*[torch.arange(5.0)] * 3), torch.tensor([125])
    return three_nn(grid + 0.5, counts, grid, counts)[1]


@pytest.mark.parametrize(
    "decide",
    [one_stage_detections, two_stage_detections, far_points, box_of_points, pooled_points,
     places_in_rois, three_nearest],
)  # fmt: skip
def test_decisions_do_not_depend_on_last_bits(decide):
    expected = decide()
    assert len(expected.unique(dim=0)) > 20
    for seed in range(3):
        with LastBits(seed):
            assert torch.equal(decide(), expected)


def test_both_paths_decide_alike_on_the_border():
    assert torch.equal(box_of_points(), box_of_points(_first_box_triton))


def test_scores_fall_with_their_logits():
    with LastBits(0):
        logits, boxes = border_logits(), second_stage()
    assert (boxes["scores"].diff() <= 0).all()
    assert (logits[boxes["boxes"][:, 0].long()].diff() <= 0).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_another_machines_numbers(dtype):
    """One unit in the last place at most, the same for the same seed, in place too."""
    values = torch.linspace(0.1, 3, 1000, dtype=dtype)
    results = []
    for _ in range(2):
        with LastBits(0):
            results += [values.clone().sqrt_(), values.sqrt() + 0 * values.exp()]
    unit = torch.finfo(dtype).eps * 2 ** results[0].log2().floor()
    off = (results[0] - values.sqrt()) / unit
    assert set(off.round().tolist()) >= {-1, 0, 1}
    assert off.abs().max() < 2.5  # the machine's own root may be a unit off
    assert torch.equal(results[0], results[2])
    with LastBits(0):
        assert torch.equal(values.square() + values**2, 2 * values * values)
        assert torch.tensor([0.0, 1.0, 4.0]).pow(0.5)[:2].tolist() == [0, 1]
