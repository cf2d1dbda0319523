"""PV-RCNN: stages against OpenPCDet, the second stage against loops.

`voxel_order_0` of openpcdet/pv_rcnn.npz: rows of frame 0 in the order in which OpenPCDet's
voxeliser took them; `order_0` is the order of the keypoints' sampling.

OpenPCDet's reference run says nothing about the second stage: random weights make boxes of 1e-7 to
1e7 metres, no ball of a RoI holds a keypoint, so the batch norm statistics taken from that run have
variance 0 and the outputs are rounding errors times 1e5.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.training.anchor_reference import (
    assert_first_stage_and_proposals_are_openpcdets,
    network_and_first_stage,
)
from tests.training.openpcdet_reference import DATA as REFERENCES
from tests.training.openpcdet_reference import points, reference, worst_error
from tests.training.plain_layers import as_images, ball_features, waken
from tests.training.synthetic_scenes import batch
from training import build_detector
from training.detectors.backbones.set_abstraction import BallSettings
from training.detectors.backbones.voxel_set_abstraction import Keypoints
from training.detectors.detector import Selection
from training.detectors.heads.pv_rcnn_head import PvRcnnHead
from training.detectors.pv_rcnn import OPENPCDET

pytestmark = pytest.mark.usefixtures("one_thread")

CLASSES = ("Car", "Pedestrian", "Cyclist")
DATA = reference("pv_rcnn")


@pytest.fixture(scope="module")
def openpcdet():
    return network_and_first_stage("pv_rcnn", DATA)


def test_first_stage_and_proposals_are_openpcdets(openpcdet):
    assert_first_stage_and_proposals_are_openpcdets(DATA, *openpcdet)


def first_seen_voxels(data, grid):
    """Voxels (N, 4) in the order of OpenPCDet's voxeliser: that of their first points."""
    cloud = np.load(REFERENCES / "points.npz")["frame_0"][data["voxel_order_0"]]
    low, size = (np.array(item, np.float32) for item in (grid.point_range[:3], grid.size))
    cells = np.floor((cloud[:, :3] - low) / size).astype(int)[:, ::-1]
    return torch.tensor([(0, *cell) for cell in dict.fromkeys(map(tuple, cells.tolist()))])


def in_openpcdets_order(coordinates, padding, shape):
    """Sites of a convolution of kernel 3 and stride 2 in the order in which spconv finds them.

    Its CPU implementation goes through the kernel, and for each position through the input. Which
    voxels of a ball are the first ones, and thus its samples, depends on that order.
    """
    sites = {}
    for position in itertools.product(range(3), repeat=3):
        shifted = coordinates[:, 1:] + torch.tensor(padding) - torch.tensor(position)
        out = shifted // 2
        fits = ((shifted % 2 == 0) & (out >= 0) & (out < torch.tensor(shape))).all(dim=1)
        for site in torch.cat([coordinates[fits, :1], out[fits]], dim=1).tolist():
            sites.setdefault(tuple(site))
    return torch.tensor(list(sites))


def in_order(voxels, coordinates):
    row = {tuple(site): i for i, site in enumerate(voxels.coordinates.tolist())}
    rows = torch.tensor([row[tuple(site)] for site in coordinates.tolist()])
    assert len(rows) == len(voxels.coordinates)
    return replace(voxels, features=voxels.features[rows], coordinates=coordinates)


@torch.no_grad()
def test_keypoints_are_openpcdets(openpcdet):
    model, first = openpcdet
    order = first_seen_voxels(DATA, model.grid)
    scales = {"x_conv1": in_order(first.scales["x_conv1"], order)}
    paddings = {"x_conv2": (1, 1, 1), "x_conv3": (1, 1, 1), "x_conv4": (0, 1, 1)}
    for name, padding in paddings.items():
        order = in_openpcdets_order(order, padding, first.scales[name].shape)
        scales[name] = in_order(first.scales[name], order)
    frames = points(DATA)
    counts = [len(frame) for frame in frames]
    keypoints = model.pfe(torch.cat(frames), counts, scales, first.bev)
    frame = torch.repeat_interleave(torch.tensor(keypoints.counts))[:, None]
    places = torch.cat([frame, keypoints.xyz], dim=1)
    assert worst_error(DATA, "eval/pfe/point_coords", places) == 0
    logits = model.point_head(keypoints.sources)
    outputs = {
        "eval/pfe/point_features_before_fusion": keypoints.sources,
        "eval/pfe/point_features": keypoints.features,
        "raw/point_head/point_cls_preds": logits,
        "eval/point_head/point_cls_scores": logits.sigmoid()[:, 0],
    }
    assert all(worst_error(DATA, *item) < 2e-5 for item in outputs.items())


def head_and_keypoints():
    """A head whose batch norms are no identity, float64, and keypoints of two frames."""
    torch.manual_seed(0)
    balls = BallSettings((0.8, 1.2), (3, 4), ((5, 4), (4, 6)))
    settings = replace(OPENPCDET.roi_head, grid=3, balls=balls, shared=(8, 6), branch=(5, 7))
    head = waken(PvRcnnHead(4, settings).double())
    for branch in (head.cls_layers, head.reg_layers):
        torch.nn.init.normal_(branch[-1].weight)
    xyz = torch.rand(70, 3).double() * torch.tensor([6.0, 6.0, 2.0])
    features = torch.randn(70, 4).double()
    return head, Keypoints(xyz, [30, 40], features, features)


def rois():
    centres = torch.rand(2, 5, 3).double() * torch.tensor([6.0, 6.0, 2.0])
    sizes = torch.rand(2, 5, 3).double() * 3 + 0.5
    return torch.cat([centres, sizes, torch.randn(2, 5, 1).double() * 2], dim=2)


@pytest.mark.usefixtures("last_bits")
def test_second_stage_is_that_of_loops():
    head, keypoints = head_and_keypoints()
    boxes = rois()
    foreground = torch.rand(70, 1).double()
    with torch.no_grad():
        output = head(keypoints, foreground, boxes)
        refined = head.refine(output, boxes)
        pooled = torch.zeros(10, 10, 3, 3, 3).double()  # channels of both balls, x, y, z
        for r, box in enumerate(boxes.flatten(0, 1)):
            frame_rows = slice(0, 30) if r < 5 else slice(30, 70)
            xyz, rows = keypoints.xyz[frame_rows], (keypoints.features * foreground)[frame_rows]
            for cell in torch.cartesian_prod(*[torch.arange(3)] * 3).tolist():
                x, y, z = ((torch.tensor(cell) + 0.5) / 3 - 0.5) * box[3:6]
                cos, sin = torch.cos(box[6]), torch.sin(box[6])
                place = box[:3] + torch.stack([x * cos - y * sin, x * sin + y * cos, z])
                of_ball = ball_features(head.roi_grid_pool_layer, xyz, rows, place)
                pooled[(r, slice(None), *cell)] = of_ball
        shared = as_images(head.shared_fc_layer, pooled.view(10, -1, 1, 1))
        logits, residuals = (
            as_images(frame_rows, shared)[..., 0, 0]
            for frame_rows in (head.cls_layers, head.reg_layers)
        )
        torch.testing.assert_close(output.logits, logits)
        torch.testing.assert_close(output.residuals, residuals)
    assert (pooled.flatten(2).std(dim=2) > 0).any(dim=1).all(), "balls with keypoints"
    # Sizes and yaw by hand.
    sizes = boxes.view(10, 7)[:, 3:6] * residuals[:, 3:6].exp()
    torch.testing.assert_close(refined.view(10, 7)[:, 3:6], sizes)
    torch.testing.assert_close(refined[..., 6].flatten(), boxes[..., 6].flatten() + residuals[:, 6])


def test_losses_and_what_selection_leaves():
    torch.manual_seed(0)
    model = build_detector("pv_rcnn_tiny", CLASSES).train()
    losses = model.loss(*batch(seed=1, fewest=5))
    assert losses.keys() >= {"classification", "point_cls", "rcnn_cls", "rcnn_reg", "rcnn_corner"}
    torch.testing.assert_close(2 * losses["loss"], torch.stack([*losses.values()]).sum())
    losses["loss"].backward()
    for part in (model.backbone_3d, model.pfe, model.point_head, model.roi_head.cls_layers):
        assert all(p.grad.isfinite().all() for p in part.parameters())
        assert any(p.grad.abs().sum() > 0 for p in part.parameters())
    clouds, most = batch()[0], model.roi_head.settings.test.post
    for selection, count in ((Selection(score=0.0, nms=0.1, post=5), 5), (Selection(score=1.0), 0)):
        detected = model.predict(clouds, selection)[0]
        assert detected["boxes"].shape == (count, 7)
        assert detected["refined"].shape == (most, 7), "all of them"


def test_the_papers_preset_has_its_range_and_anchors():
    ours = build_detector("pv_rcnn", CLASSES, preset="paper")
    assert ours.point_range == pytest.approx((0, -20, -3, 40, 20, 1))
    assert ours.dense_head.anchors[0, 0, ::2, 3:6].tolist() == [
        pytest.approx(size) for size in ((3.9, 1.6, 1.56), (0.7, 0.7, 1.5), (1.5, 0.9, 1.0))
    ]
