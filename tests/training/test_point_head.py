"""Heads on points: their targets, residuals and losses by hand."""

import math

import pytest
import torch

from training.detectors.heads.losses import focal_loss
from training.detectors.heads.point_head import (
    PointHeadBox,
    PointOutput,
    PointTargets,
    decode_points,
    encode_points,
    point_targets,
    segmentation_loss,
)

pytestmark = pytest.mark.usefixtures("last_bits")

SIZES = [[3.9, 1.6, 1.56], [0.8, 0.6, 1.73]]


def test_points_take_the_object_around_them():
    car = [1.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0]
    turned = [1.0, 0.0, 1.0, 4.0, 2.0, 2.0, math.pi / 2]
    # The third is 5 cm outside: neither. Then one of background, one of the second frame, without
    # objects, and three of the third, whose car stands across.
    x, y = [1.0, 2.9, 3.05, 3.15, 2.9, 2.9, 1.9, 1.0], [0.0, 0.9, 0.0, 0.0, 0.9, 0.9, 1.9, 2.09]
    xyz = torch.tensor([x, y, [1.0, 1.9, 1.0, 1.0, 1.9, 1.9, 1.9, 1.0]]).T
    boxes = [torch.tensor([car]), torch.zeros(0, 7), torch.tensor([[50.0, *car[1:]], turned])]
    labels = [torch.tensor([2]), torch.zeros(0, dtype=torch.int64), torch.tensor([1, 3])]
    targets = point_targets(xyz, [4, 1, 3], boxes, labels)
    assert targets.labels.tolist() == [2, 2, -1, 0, 0, 0, 3, -1]
    nothing = [0.0] * 7
    expected = [car, car, nothing, nothing, nothing, nothing, turned, nothing]
    assert torch.equal(targets.boxes, torch.tensor(expected))


def test_encoding_and_decoding_are_inverse():
    torch.manual_seed(0)
    boxes = torch.rand(50, 7) * 4 + 0.5
    boxes[:, 6] -= math.pi
    xyz, sizes = torch.rand(50, 3), torch.rand(50, 3) + 0.5
    residuals = encode_points(boxes, xyz, sizes)
    assert residuals.shape == (50, 8)
    torch.testing.assert_close(decode_points(residuals, xyz, sizes), boxes)
    # Only the direction of (cosine, sine) counts.
    residuals[:, 6:] *= 3
    torch.testing.assert_close(decode_points(residuals, xyz, sizes), boxes)
    # By hand: a diagonal of 5 m, a height of 2 m, twice as long.
    box = torch.tensor([[6.0, -5.0, 2.0, 8.0, 3.0, 2.0, math.pi / 2]])
    residuals = encode_points(box, torch.tensor([[1.0, 0.0, 0.0]]), torch.tensor([[4.0, 3.0, 2.0]]))
    expected = torch.tensor([[1.0, -1.0, 1.0, math.log(2), 0.0, 0.0, 0.0, 1.0]])
    torch.testing.assert_close(residuals, expected, atol=1e-6, rtol=0)


def test_segmentation_loss_by_hand():
    labels = torch.tensor([1, 2, 0, -1, 1])
    logits = torch.zeros(5, 2)
    positive, other = 0.25 * 0.25 * math.log(2), 0.75 * 0.25 * math.log(2)
    expected = (3 * (positive + other) + 2 * other) / 3
    assert segmentation_loss(logits, labels).item() == pytest.approx(expected)
    agnostic = segmentation_loss(logits[:, :1], labels)
    assert agnostic.item() == pytest.approx((3 * positive + other) / 3)
    # Nothing is divided by zero where no point lies on an object.
    background = segmentation_loss(logits, torch.zeros_like(labels))
    assert background.item() == pytest.approx(10 * other)
    assert segmentation_loss(logits[:0], labels[:0]) == 0


def test_focal_loss_at_its_ends():
    lost = focal_loss(torch.tensor([[300.0, -300.0]]), torch.tensor([[False, True]]), torch.ones(1))
    assert lost.item() == pytest.approx(0.75 * 300 + 0.25 * 300)
    assert focal_loss(torch.tensor([[math.nan]]), torch.tensor([[True]]), torch.ones(1)).isnan()


@pytest.mark.parametrize("target", [False, True])
def test_gradient_of_the_focal_loss(target):
    places = [-100.0, -30.0, -5.0, 0.0, 5.0, 30.0, 100.0]
    logits = torch.tensor(places, dtype=torch.float64)[:, None].requires_grad_()
    focal_loss(logits, torch.full((7, 1), target), torch.full((7,), 0.5)).backward()
    for place, slope in zip(places, logits.grad.flatten().tolist(), strict=True):
        z, sign, alpha = (-place, -1, 0.25) if target else (place, 1, 0.75)
        p, loss = 1 / (1 + math.exp(-z)), math.log1p(math.exp(z))
        expected = 0.5 * sign * alpha * p**2 * (2 * (1 - p) * loss + p)
        assert slope == pytest.approx(expected, rel=1e-8, abs=0)


def test_box_loss_by_hand():
    head = PointHeadBox(4, (8,), SIZES, either_way=False)
    boxes = torch.tensor(
        [[0.0, 0.0, 0.0, 3.9, 1.6, 1.56, 0.0], [0.0] * 7, [1.0, 0.0, 0.0, 0.8, 0.6, 1.73, 0]]
    )
    targets = PointTargets(torch.tensor([1, 0, 2]), boxes)
    xyz = torch.zeros(3, 3)
    residuals = torch.zeros(3, 8)
    residuals[[0, 2], 6] = 1.0  # yaw 0
    residuals[0, 3] = 1 / 18  # half of beta
    residuals[1] = 100.0  # background: does not count
    losses = head.loss(PointOutput(torch.zeros(3, 2), residuals), targets, xyz)
    assert losses["point_box"].item() == pytest.approx((1 / 72 + 1 - 1 / 18) / 2)
    assert losses["point_cls"] == segmentation_loss(torch.zeros(3, 2), targets.labels)


def test_boxes_have_the_size_of_the_likeliest_class():
    head = PointHeadBox(4, (8,), SIZES, either_way=False)
    residuals = torch.zeros(2, 8)
    residuals[:, 7] = 1.0
    output = PointOutput(torch.tensor([[0.0, 1.0], [3.0, 2.0]]), residuals)
    boxes = head.decode(output, torch.tensor([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    expected = [[1, 2, 3, *SIZES[1], math.pi / 2], [4, 5, 6, *SIZES[0], math.pi / 2]]
    torch.testing.assert_close(boxes, torch.tensor(expected))


@pytest.mark.parametrize("either_way", [True, False])
def test_a_box_may_point_backwards(either_way):
    head = PointHeadBox(4, (8,), SIZES, either_way)
    box = torch.tensor([[0.0, 0.0, 0.0, *SIZES[0], math.pi / 4]])
    targets = PointTargets(torch.tensor([1]), box)
    residuals = encode_points(box, torch.zeros(1, 3), torch.tensor(SIZES[:1]))
    residuals[:, 6:] *= -1
    losses = head.loss(PointOutput(torch.zeros(1, 2), residuals), targets, torch.zeros(1, 3))
    expected = 0.0 if either_way else 2 * (math.sqrt(2) - 1 / 18)
    assert losses["point_box"].item() == pytest.approx(expected, abs=1e-6)
