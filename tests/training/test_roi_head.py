"""Proposals, their sample, boxes in RoIs and the losses of a second stage, against brute force."""

import math

import numpy as np
import pytest
import torch
from torch.nn import functional

from training.detectors.detector import Selection
from training.detectors.heads.proposals import Proposals, Suppression, propose
from training.detectors.heads.roi_box_coder import decode_in_rois, encode_in_rois, roi_grid, turned
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings, corner_loss
from training.detectors.heads.roi_targets import RoiSampling, sample_rois, score_targets
from training.ops.box_overlap import iou_3d

SETTINGS = RoiSettings(
    train=Suppression(nms=0.8, pre=100, post=20),
    test=Suppression(nms=0.7, pre=50, post=10),
    sampling=RoiSampling(rois=16),
)


def boxes_near(count, seed, spread=10.0):
    random = np.random.default_rng(seed)
    low, high = (-spread, -spread, -1, 3, 1.4, 1.3, -4), (spread, spread, 1, 5, 2.2, 1.8, 4)
    return torch.from_numpy(random.uniform(low, high, (count, 7)).astype(np.float32))


def cubes(xs):
    boxes = torch.zeros(len(xs), 7)
    boxes[:, 0], boxes[:, 3:6] = torch.tensor(xs), 2
    return boxes


def proposals_of(boxes, labels=None):
    labels = torch.ones(len(boxes), dtype=torch.int64) if labels is None else labels
    return Proposals(boxes[None], torch.zeros(1, len(boxes)), labels[None])


def targets_of(rois, objects):
    torch.manual_seed(0)
    labels = torch.ones(len(objects), dtype=torch.int64)
    return sample_rois(proposals_of(rois), [objects], [labels], SETTINGS.sampling)


def test_proposals_by_hand():
    boxes = cubes([0.0, 0.1, 10.0, 20.0, 30.0])
    boxes[4, 6] = torch.inf
    logits = torch.tensor([[1.0, -9], [-9, 2], [-5, -6], [3, -9], [9, 9]])
    one_logits, one_box = (torch.full_like(part, torch.nan) for part in (logits, boxes))
    one_logits[3], one_box[3] = logits[2], boxes[2]
    pairs = torch.stack([logits, one_logits]), torch.stack([boxes, one_box])
    proposals = propose(*pairs, Suppression(0.5, pre=3, post=4))
    assert proposals.boxes.shape == (2, 4, 7)
    # The box that is not finite is none; 0 is hidden by 1; pre leaves 3, 1 and 0.
    assert proposals.boxes[0, :, 0].tolist() == pytest.approx([20, 0.1, 0, 0])
    assert proposals.scores.tolist() == [[3, 2, 0, 0], [-5, 0, 0, 0]]
    assert proposals.labels.tolist() == [[1, 2, 1, 1], [1, 1, 1, 1]]
    assert (proposals.boxes[0, 2:] == 0).all()
    assert proposals.labels.dtype == torch.int64
    proposals = propose(torch.zeros(1, 0, 3), torch.zeros(1, 0, 7), Suppression(0.5, 10, 4))
    assert torch.equal(proposals.boxes, torch.zeros(1, 4, 7))


@pytest.mark.usefixtures("last_bits")
def test_encoding_in_a_roi_and_decoding_are_inverse():
    boxes, rois = boxes_near(200, 0).double(), boxes_near(200, 1).double()
    residuals = encode_in_rois(boxes, rois)
    assert (residuals[:, 6].abs() <= math.pi / 2).all()
    decoded = decode_in_rois(residuals, rois)
    torch.testing.assert_close(decoded[:, :6], boxes[:, :6])
    turn = (decoded[:, 6] - boxes[:, 6]) / math.pi
    torch.testing.assert_close(turn, turn.round(), atol=1e-9, rtol=0)
    assert (turn.round() % 2).sum() > 20  # some are turned round

    # By hand: 3 m ahead of the RoI, which faces along y: 3 m along y in the frame of both.
    roi = torch.tensor([[1.0, 2.0, 0.0, 4.0, 3.0, 2.0, math.pi / 2]])
    box = torch.tensor([[1.0, 5.0, 1.0, 8.0, 3.0, 2.0, -math.pi / 2 + 0.1]])
    expected = torch.tensor([[0.6, 0.0, 0.5, math.log(2), 0.0, 0.0, 0.1]])
    torch.testing.assert_close(encode_in_rois(box, roi), expected, atol=1e-6, rtol=1e-6)


@pytest.mark.usefixtures("last_bits")
def test_grid_of_a_roi_by_hand_is_turned_counterclockwise():
    roi = torch.tensor([[10.0, 0.0, 0.0, 4.0, 2.0, 2.0, math.pi / 2]])
    grid = roi_grid(roi, 2)
    # The cell at the back, on the right, below: 1 m back along -y, 0.5 m to the right along x.
    torch.testing.assert_close(grid[0, 0], torch.tensor([10.5, -1.0, -0.5]))
    torch.testing.assert_close(grid[0, 1], torch.tensor([10.5, -1.0, 0.5]))
    torch.testing.assert_close(grid[0, 4], torch.tensor([10.5, 1.0, -0.5]))
    torch.testing.assert_close(grid.mean(dim=1), roi[:, :3])
    points = turned(torch.tensor([[[1.0, 0.0, 5.0]]]), torch.tensor([math.pi / 2]))
    torch.testing.assert_close(points, torch.tensor([[[0.0, 1.0, 5.0]]]))


def test_sample_has_the_objects_and_shares_of_the_settings():
    torch.manual_seed(0)
    objects = boxes_near(6, 2)
    noise = torch.randn(300, 7) * torch.tensor([0.5, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1])
    rois = torch.cat([objects.repeat(50, 1) + noise, boxes_near(200, 3)])
    labels = torch.randint(1, 3, (500,))
    object_labels = torch.tensor([1, 1, 1, 2, 2, 2])
    sampling = RoiSampling(rois=64)
    sample = sample_rois(proposals_of(rois, labels), [objects], [object_labels], sampling)
    assert sample.rois.boxes.shape == (1, 64, 7)
    iou = iou_3d(sample.rois.boxes, objects[None])[0]
    iou = iou * (sample.rois.labels[0][:, None] == object_labels)
    best, row = iou.max(dim=1)
    torch.testing.assert_close(sample.boxes[0][best > 0], objects[row[best > 0]])
    assert (sample.regress[0] == (best > 0.55)).all()
    assert sample.regress.sum() == 32
    assert ((best >= 0.1) & (best < 0.55)).sum() == 25  # int(0.8 * 32)
    assert (best < 0.1).sum() == 7
    foreground = sample.rois.boxes[0][:32]
    assert len(foreground.unique(dim=0)) == 32  # without replacement
    torch.testing.assert_close(sample.scores[0], ((best - 0.25) / 0.5).clamp(0, 1))


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        ("f", (16, 0, 0)),  # nothing else: with replacement
        ("fh", (3, 13, 0)),
        ("fe", (3, 0, 13)),
        ("h", (0, 16, 0)),
        ("e", (0, 0, 16)),
        ("he", (0, 3, 13)),  # hard background too is at most all there is
        ("fhe", (3, 3, 10)),
    ],
)
def test_sample_of_every_mixture(kinds, expected):
    target = torch.tensor([[0.0, 0.0, 0.0, 4.0, 2.0, 2.0, 0.0]])
    shift = {"f": 0.1, "h": 2.0, "e": 30.0}
    rois = target.repeat(3 * len(kinds), 1)
    rois[:, 0] = torch.tensor([shift[kind] for kind in kinds for _ in range(3)])
    xs = targets_of(rois, target).rois.boxes[0, :, 0]
    assert [xs.eq(value).sum().item() for value in shift.values()] == list(expected)


def test_frames_without_objects_and_zero_proposals_are_background():
    rois = torch.cat([boxes_near(5, 0), torch.zeros(5, 7)])
    sample = targets_of(rois, torch.zeros(0, 7))
    assert not sample.regress.any()
    assert (sample.scores == 0).all()
    assert (targets_of(torch.zeros(4, 7), boxes_near(1, 1)).scores == 0).all()


def test_score_targets():
    iou = torch.tensor([0.0, 0.25, 0.3, 0.5, 0.6, 0.75, 1.0])
    share = score_targets(iou, RoiSampling())
    torch.testing.assert_close(share, torch.tensor([0, 0, 0.1, 0.5, 0.7, 1, 1]))
    kind = score_targets(iou, RoiSampling(score="cls", cls_background=0.45, cls_foreground=0.7))
    assert kind.tolist() == [0, 0, 0, -1, -1, 1, 1]


@pytest.mark.usefixtures("last_bits")
def test_corner_loss_by_hand():
    box = torch.tensor([[1.0, 2.0, 3.0, 4.0, 2.0, 1.5, 0.3]])
    moved = box + torch.tensor([0.0, 0.0, 0.5, 0, 0, 0, math.pi])
    torch.testing.assert_close(corner_loss(moved, box), torch.tensor([0.125]))  # 0.5² / 2
    far = box + torch.tensor([0.0, 3.0, 0.0, 0, 0, 0, 0])
    torch.testing.assert_close(corner_loss(far, box), torch.tensor([2.5]))  # 3 - 0.5
    wide = box + torch.tensor([0, 0, 0, 0, 0.0, 0.6, 0])
    torch.testing.assert_close(corner_loss(wide, box), torch.tensor([0.045]))  # 0.3² / 2


def targets_and_output():
    """Outputs and targets of 16 RoIs, some of which learn a box, float64."""
    objects = boxes_near(4, 5).double()
    targets = targets_of(torch.cat([objects + 0.05, boxes_near(20, 6).double()]), objects)
    assert 0 < targets.regress.sum() < 16
    torch.manual_seed(1)
    return targets, RoiOutput(torch.randn(16, 1).double(), 0.1 * torch.randn(16, 7).double())


@pytest.mark.usefixtures("last_bits")
def test_losses_against_their_formulas():
    targets, output = targets_and_output()
    count = int(targets.regress.sum())
    losses = RoiHead(SETTINGS).loss(output, targets)
    chance = output.logits[:, 0].sigmoid()
    wanted = targets.scores[0]
    entropy = -(wanted * chance.log() + (1 - wanted) * (1 - chance).log())
    torch.testing.assert_close(losses["rcnn_cls"], entropy.mean())
    regression = corner = 0.0
    for i in range(16):
        if not targets.regress[0, i]:
            continue
        roi, box = targets.rois.boxes[0, i], targets.boxes[0, i]
        expected = encode_in_rois(box, roi)
        gap = (output.residuals[i] - expected).abs()
        regression += torch.where(gap < 1 / 9, 4.5 * gap**2, gap - 1 / 18).sum()
        corner += corner_loss(decode_in_rois(output.residuals[i], roi)[None], box[None])[0]
    torch.testing.assert_close(losses["rcnn_reg"], regression / count)
    torch.testing.assert_close(losses["rcnn_corner"], corner / count)


def test_scores_that_learn_nothing_do_not_count():
    rois = boxes_near(16, 0)
    targets = targets_of(rois, rois[:0])
    targets.scores[0, 4:] = -1
    logits = torch.randn(16, 1, requires_grad=True)
    losses = RoiHead(SETTINGS).loss(RoiOutput(logits, torch.zeros(16, 7)), targets)
    expected = functional.softplus(logits[:4]).mean()
    torch.testing.assert_close(losses["rcnn_cls"], expected)
    assert losses["rcnn_reg"] == losses["rcnn_corner"] == 0
    losses["rcnn_cls"].backward()
    assert (logits.grad[4:] == 0).all()


def test_gradients_of_the_losses():
    targets, output = targets_and_output()

    def loss(*raw):
        return torch.stack(list(RoiHead(SETTINGS).loss(RoiOutput(*raw), targets).values()))

    raw = (output.logits.requires_grad_(), output.residuals.requires_grad_())
    assert torch.autograd.gradcheck(loss, raw)


@pytest.mark.usefixtures("last_bits")
def test_detections_leave_out_what_fills_up():
    rois = torch.cat([cubes([0.0, 0.2, 10.0]), torch.zeros(1, 7)])[None]
    proposals = Proposals(rois, torch.zeros(1, 4), torch.tensor([[1, 2, 3, 1]]))
    output = RoiOutput(torch.tensor([[0.0], [1.0], [-9.0], [5.0]]), torch.zeros(4, 7))
    head = RoiHead(SETTINGS)
    (detected,) = head.detections(output, proposals, Selection(score=0.1, nms=0.1))
    assert detected["labels"].tolist() == [2]
    torch.testing.assert_close(detected["boxes"], rois[0, 1:2])
    torch.testing.assert_close(detected["scores"], torch.tensor([1.0]).sigmoid())
    torch.testing.assert_close(detected["refined"], rois[0, :3])
    (detected,) = head.detections(RoiOutput(output.logits, None), proposals, Selection(nms=1.0))
    assert detected["labels"].tolist() == [2, 1]
