"""PointPillars against OpenPCDet, and the parts of an anchor head by hand.

tests/data/openpcdet/pointpillar.npz, see openpcdet_reference; `cells` and `counts` are its pillars:
frame * ny * nx + iy * nx + ix and the number of points.
"""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.training.anchor_reference import assert_head_is_openpcdets, assert_training_is_openpcdets
from tests.training.openpcdet_reference import points, reference, weights, worst_error
from training import build_detector
from training.detectors.backbones.pillar_image import pillar_image
from training.detectors.backbones.pillars import (
    PaddedBatchNorm,
    PillarEncoder,
    PillarGrid,
    group,
    scatter,
)
from training.detectors.detector import Selection
from training.detectors.heads.anchor_targets import _assign_triton, anchor_rules, assign_targets
from training.detectors.heads.anchors import AnchorClass, anchor_grid
from training.detectors.heads.box_coder import decode, encode
from training.detectors.heads.selection import select_boxes

DATA = reference("pointpillar")
CLASSES = ("Car", "Pedestrian", "Cyclist")

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def openpcdet():
    model = build_detector("pointpillars", CLASSES, preset="openpcdet")
    model.load_state_dict(weights(model.state_dict(), DATA))
    return model.eval()


def test_pillars_are_openpcdets(openpcdet):
    batch = group(points(DATA), openpcdet.grid, training=False, device=torch.device("cpu"))
    assert openpcdet.grid.shape == (432, 496)
    assert batch.cells.tolist() == DATA["cells"].tolist()
    assert batch.counts.tolist() == DATA["counts"].tolist()
    features = openpcdet.vfe(batch)
    assert worst_error(DATA, "eval/vfe/pillar_features", features) < 1e-5


def test_outputs_losses_and_gradients_are_openpcdets(openpcdet):
    output = openpcdet.head_output(points(DATA))
    assert_head_is_openpcdets(openpcdet, DATA, output)
    assert_training_is_openpcdets(openpcdet, DATA, output, tolerance=1e-3)


def test_range_in_the_ego_frame_grows_to_whole_cells():
    tiny = build_detector("pointpillars_tiny", ["Car"], point_range=(0, -20, 0, 40.5, 20, 3.0))
    nx, ny = tiny.grid.shape
    size = tiny.grid.size[0]
    assert tiny.point_range == pytest.approx((0, -20, 0, nx * size, -20 + ny * size, 3))
    assert tiny.point_range == pytest.approx((0, -20, 0, 41.6, 20, 3))


def test_grouping_keeps_the_first_points_and_pillars():
    grid = PillarGrid((0.0, 0.0, 0.0, 2.0, 1.0, 1.0), (1.0, 1.0), max_points=2, max_pillars=(1, 2))
    # The fourth is the third of its pillar; the last two are on far faces: outside.
    x, z = [1.5, 0.5, 1.2, 1.1, 0.5, 2.0], [0.5, 0.5, 0.5, 0.5, 1.0, 0.5]
    points = torch.tensor([x, [0.5] * 6, z, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]]).T.contiguous()
    device = torch.device("cpu")
    batch = group([points, points[:0], points], grid, training=False, device=device)
    assert batch.cells.tolist() == [1, 0, 5, 4]
    assert batch.counts.tolist() == [2, 1, 2, 1]
    assert batch.points[:, 3].tolist() == pytest.approx([0.0, 0.2, 0.1] * 2)
    assert batch.pillar.tolist() == [0, 0, 1, 2, 2, 3]
    one = group([points], grid, training=True, device=device)
    assert one.cells.tolist() == [1]


@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("limits", [(None, None), (3, (40, 40)), (3, (5, 40)), (1, (1, 1))])
def test_the_image_in_one_pass_is_that_of_the_modules(limits, dtype, training):
    torch.manual_seed(0)
    grid = PillarGrid((0.0, -2.0, -1.0, 4.0, 2.0, 1.0), (0.5, 0.4), *limits)
    encoder = PillarEncoder(grid, 7, 0.1)
    norm, init = encoder.pfn_layers[0].norm, torch.nn.init
    init.uniform_(norm.running_mean, -1, 1)
    init.uniform_(norm.running_var, 0.1, 2)
    init.uniform_(norm.weight, -2, 2)
    init.uniform_(norm.bias, -1, 1)
    encoder.to(dtype).train(training)
    low, high = torch.tensor([-0.5, -2.2, -1.1, 0.0]), torch.tensor([4.5, 2.2, 1.1, 1.0])
    frames = [torch.rand(count, 4) * (high - low) + low for count in (300, 0, 40, 1)]
    frames[0][:3, 0], frames[0][3, 3] = math.nan, math.inf
    frames[0][4] = torch.tensor([4.0, 2.0, 1.0, 0.5])  # on the far corner: outside
    ours, unlearnt = copy.deepcopy(encoder), copy.deepcopy(encoder)
    batch = group(frames, grid, training=training, device=torch.device("cpu"))
    batch = replace(batch, points=batch.points.to(dtype))
    expected = scatter(encoder(batch), batch.cells, len(frames), grid)
    image = pillar_image(frames, ours)
    assert expected[0].count_nonzero() > 0
    assert image.is_contiguous(memory_format=torch.channels_last)
    close = {"rtol": 1e-4, "atol": 1e-5} if dtype == torch.float32 else {"rtol": 1e-6, "atol": 1e-6}
    torch.testing.assert_close(image, expected, **close)
    with torch.no_grad():
        assert torch.equal(pillar_image(frames, unlearnt), image)
    gradient = torch.randn_like(expected)
    expected.backward(gradient)
    image.backward(gradient)
    for one, other in zip(encoder.parameters(), ours.parameters(), strict=True):
        torch.testing.assert_close(other.grad, one.grad, **close | {"atol": 1e-3})
    for one, other in zip(encoder.buffers(), ours.buffers(), strict=True):
        torch.testing.assert_close(other, one, **close)


def test_few_anchors_decoded_are_those_of_all():
    torch.manual_seed(0)
    head = build_detector("pointpillars_tiny", ["Car", "Cyclist"]).dense_head
    with torch.no_grad():
        output = head(torch.randn(3, head.conv_cls.in_channels, *head.anchors.shape[:2]))
        output.logits.normal_()
        output.logits[1] = -9.0
        output.logits[2, :5] = math.nan
        all_logits, all_boxes = head.decode(output)
    for lowest in (-math.inf, 0.0, 2.5, 99.0):
        few = zip(*head.decode_likely(output, lowest), all_logits, all_boxes, strict=True)
        for logits, boxes, frame_logits, frame_boxes in few:
            likely = (frame_logits >= lowest).any(dim=1)
            count = likely.sum()
            assert torch.equal(logits[:count], frame_logits[likely])
            assert (logits[count:] == -math.inf).all()
            torch.testing.assert_close(boxes[:count], frame_boxes[likely])


def test_padded_batch_norm_is_batch_norm_with_the_zeros():
    torch.manual_seed(0)
    rows = torch.randn(20, 3) + 1
    ours, theirs = PaddedBatchNorm(3), torch.nn.BatchNorm1d(3)
    a = ours(rows, zeros=30)
    b = theirs(torch.cat([rows, torch.zeros(30, 3)]))[:20]
    torch.testing.assert_close(a, b)
    for key, value in theirs.state_dict().items():
        torch.testing.assert_close(ours.state_dict()[key], value)


@pytest.mark.usefixtures("last_bits")
def test_encoding_and_decoding_are_inverse():
    torch.manual_seed(0)
    boxes = torch.rand(50, 7) * 4 + 0.5
    anchors = torch.rand(50, 7) * 3 + 0.5
    torch.testing.assert_close(decode(encode(boxes, anchors), anchors), boxes)
    assert torch.isfinite(encode(torch.zeros(50, 7), anchors)).all()


def edges_of(boxes):
    """Lowest x and y, then highest, of boxes turned to the nearest multiple of 90 degrees."""
    turned = (boxes[:, 6] / math.pi + 0.5) % 1 - 0.5
    across = turned.abs() >= 0.25
    x, y = (torch.where(across == swapped, boxes[:, 3], boxes[:, 4]) / 2 for swapped in (0, 1))
    return boxes[:, 0] - x, boxes[:, 1] - y, boxes[:, 0] + x, boxes[:, 1] + y


def assign(anchors, classes, boxes, labels):
    """Assign on a CPU; checks that a GPU gives every anchor the same object."""
    rules = anchor_rules(classes)
    targets = assign_targets(anchors, rules, boxes, labels)
    other = _assign_triton(anchors, rules, boxes, labels)
    assert torch.equal(other.labels, targets.labels)
    assert torch.equal(other.boxes[targets.index], targets.boxes)
    return targets


@pytest.mark.parametrize("seed", range(5))
def test_targets_are_those_of_all_pairs(seed):
    random = np.random.default_rng(seed)
    classes = [AnchorClass((4.0, 2.0, 1.5), -1.0, 0.5, 0.35), AnchorClass((2, 1, 1), -1, 0.4, 0.2)]
    anchors = anchor_grid(classes, (0.0, 0.0, -2.0, 20.0, 16.0, 2.0), (20, 16), centred=True)
    size = [[4, 2, 1.5]] * 8 + [[2, 1, 1]] * 6
    where = random.uniform([-2, -2, 0], [22, 18, 0], (14, 3))
    yaw = random.uniform(-4, 4, (14, 1))
    boxes = torch.tensor(np.hstack([where, size * random.uniform(0.5, 1.5, (14, 3)), yaw])).float()
    labels = torch.tensor([1] * 8 + [2] * 6)
    targets = assign(anchors, classes, [boxes, boxes[:0]], [labels, labels[:0]])
    assert targets.labels[1].count_nonzero() == targets.index[0].count_nonzero() == 0
    empty = assign(anchors, classes, [boxes[:0]], [labels[:0]])
    assert torch.equal(empty.labels[0], targets.labels[1])
    assert empty.boxes.shape == (0, 7)
    expected = torch.full(anchors.shape[:3], -1)
    chosen = torch.zeros(anchors.shape[:3], dtype=torch.int64)
    for label, item in enumerate(classes, 1):
        of_class = torch.nonzero(labels == label).flatten()
        part = slice(2 * label - 2, 2 * label)
        ax0, ay0, ax1, ay1 = (edge[:, None] for edge in edges_of(boxes[of_class]))
        bx0, by0, bx1, by1 = edges_of(anchors[:, :, part].reshape(-1, 7))
        dx = (torch.minimum(ax1, bx1) - torch.maximum(ax0, bx0)).clamp_min(0)
        dy = (torch.minimum(ay1, by1) - torch.maximum(ay0, by0)).clamp_min(0)
        areas = (ax1 - ax0) * (ay1 - ay0) + (bx1 - bx0) * (by1 - by0)
        overlap = dx * dy / (areas - dx * dy)
        best, target = overlap.max(dim=0)
        top = overlap.amax(dim=1, keepdim=True)
        forced = ((overlap == top) & (top > 0)).any(dim=0)
        view = expected[:, :, part]
        view[(best < item.unmatched).view(view.shape)] = 0
        view[(forced | (best >= item.matched)).view(view.shape)] = label
        chosen[:, :, part] = of_class[target].view(view.shape)
    assert torch.equal(targets.labels[0], expected.flatten())
    positive = targets.index[1]
    assert torch.equal(positive, torch.nonzero(expected.flatten() > 0).flatten())
    assert len(positive) > 14
    assert torch.equal(targets.boxes, boxes[chosen.flatten()[positive]])


def test_tied_targets():
    """Equal objects, anchors that an object overlaps equally, objects on edges and outside."""
    classes = [AnchorClass((2.0, 2.0, 1.5), 0.0, 0.6, 0.3, rotations=(0.0, math.pi / 2))]
    anchors = anchor_grid(classes, (0.0, 0.0, 0.0, 8.0, 8.0, 2.0), (8, 8), centred=True)
    between, large = [3.0, 3.0, 1, 2, 2, 1, 0], [4.0, 4.0, 1, 6, 6, 1, 0]
    outside, flat = [-9.0, 0, 1, 2, 2, 1, 0], [1.0, 1.0, 1, 0, 2, 1, 0]
    boxes = torch.tensor([between, between, large, outside, flat])
    targets = assign(anchors, classes, [boxes], [torch.ones(5, dtype=torch.int64)])
    # Four anchors around the first, 16 in the third that overlap it alike; either rotation.
    assert (targets.labels == 1).sum() == 2 * 16
    near = (anchors.reshape(-1, 7)[targets.index[1], :2] - 3).abs().amax(dim=1) < 1
    assert torch.equal(targets.boxes[near], boxes[:1].expand(8, 7))
    assert torch.equal(targets.boxes[~near], boxes[2:3].expand(24, 7))


@pytest.mark.usefixtures("last_bits")
def test_selection():
    boxes = torch.zeros(4, 7)
    boxes[:, 3:6] = 2.0
    boxes[:, 0] = torch.tensor([0.0, 0.5, 10.0, 20.0])
    scores = torch.tensor([[0.3, 0.2], [0.1, 0.6], [0.5, 0.4], [0.05, 0.04]])
    (selected,) = select_boxes(scores.logit()[None], boxes[None], Selection(score=0.1, nms=0.01))
    assert selected["labels"].tolist() == [2, 1]
    assert selected["scores"].tolist() == pytest.approx([0.6, 0.5])
    assert selected["boxes"][:, 0].tolist() == [0.5, 10.0]
