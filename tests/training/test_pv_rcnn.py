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
from anchor_reference import assert_first_stage_is_openpcdets, network_and_first_stage
from openpcdet_reference import DATA as REFERENCES
from openpcdet_reference import points, reference, worst_error
from synthetic_scenes import scenes
from torch.nn import functional

from training import build_detector
from training.dataset import TrainingFrames, as_tensors
from training.detectors.backbones.voxel_set_abstraction import BallSettings, Keypoints
from training.detectors.detector import Selection
from training.detectors.heads.pv_rcnn_head import PvRcnnHead, PvRcnnHeadSettings
from training.detectors.pv_rcnn import OPENPCDET

pytestmark = pytest.mark.usefixtures("one_thread")

CLASSES = ("Car", "Pedestrian", "Cyclist")
DATA = reference("pv_rcnn")


@pytest.fixture(scope="module")
def openpcdet():
    return network_and_first_stage("pv_rcnn", DATA)


def test_first_stage_and_proposals_are_openpcdets(openpcdet):
    model, first = openpcdet
    assert sum(p.numel() for p in model.parameters()) == 13_115_697
    with torch.no_grad():
        logits, boxes = model.dense_head.decode(first.head)
        found = model.roi_head.propose(logits, boxes)
    assert_first_stage_is_openpcdets(DATA, first)
    for name, value in (
        ("eval/dense_head/batch_cls_preds", logits),
        ("eval/dense_head/batch_box_preds", boxes),
        ("eval/roi_head/roi_scores", found.scores),
        ("eval/roi_head/rois", found.boxes),
    ):
        assert worst_error(DATA, name, value) < 2e-4, name
    expected = torch.from_numpy(DATA["eval/roi_head/rois/full"])
    torch.testing.assert_close(found.boxes, expected, rtol=2e-3, atol=1e-4)
    assert found.labels.tolist() == DATA["eval/roi_head/roi_labels/full"].tolist()


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
    found = {}
    for position in itertools.product(range(3), repeat=3):
        shifted = coordinates[:, 1:] + torch.tensor(padding) - torch.tensor(position)
        out = shifted // 2
        fits = ((shifted % 2 == 0) & (out >= 0) & (out < torch.tensor(shape))).all(dim=1)
        for site in torch.cat([coordinates[fits, :1], out[fits]], dim=1).tolist():
            found.setdefault(tuple(site))
    return torch.tensor(list(found))


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
    keypoints = model.pfe(points(DATA), scales, first.bev)
    frame = torch.repeat_interleave(keypoints.counts)[:, None]
    places = torch.cat([frame, keypoints.xyz], dim=1)
    assert worst_error(DATA, "eval/pfe/point_coords", places) == 0
    logits = model.point_head(keypoints.sources)
    for name, value in (
        ("eval/pfe/point_features_before_fusion", keypoints.sources),
        ("eval/pfe/point_features", keypoints.features),
        ("raw/point_head/point_cls_preds", logits),
        ("eval/point_head/point_cls_scores", logits.sigmoid()[:, 0]),
    ):
        assert worst_error(DATA, name, value) < 2e-5, name


def head_and_keypoints():
    """A head whose batch norms are no identity, float64, and keypoints of two frames."""
    torch.manual_seed(0)
    settings = PvRcnnHeadSettings(
        rois=OPENPCDET.roi_head.rois,
        grid=3,
        balls=BallSettings((0.8, 1.2), (3, 4), ((5, 4), (4, 6))),
        shared=(8, 6),
        branch=(5, 7),
        dropout=0.3,
    )
    head = PvRcnnHead(4, settings).double()
    for name, value in head.state_dict().items():
        if name.endswith("running_mean"):
            value.uniform_(-0.5, 0.5)
        elif name.endswith(("running_var", ".bias")):
            value.uniform_(0.1, 1.5)
        elif name.endswith("layers.7.weight"):
            value.normal_()
    xyz = torch.rand(70, 3).double() * torch.tensor([6.0, 6.0, 2.0])
    features = torch.randn(70, 4).double()
    return head.eval(), Keypoints(xyz, torch.tensor([30, 40]), features, features)


def rois():
    centres = torch.rand(2, 5, 3).double() * torch.tensor([6.0, 6.0, 2.0])
    sizes = torch.rand(2, 5, 3).double() * 3 + 0.5
    return torch.cat([centres, sizes, torch.randn(2, 5, 1).double() * 2], dim=2)


def conv_mlp(layers, grid):
    """OpenPCDet's layers on (R, C, 1) with its convolutions and batch norms."""
    for layer in layers:
        if hasattr(layer, "weight") and layer.weight.ndim == 3:
            grid = functional.conv1d(grid, layer.weight, layer.bias)
        else:
            grid = layer(grid)
    return grid


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
            own = slice(0, 30) if r < 5 else slice(30, 70)
            xyz, rows = keypoints.xyz[own], (keypoints.features * foreground)[own]
            for cell in torch.cartesian_prod(*[torch.arange(3)] * 3).tolist():
                x, y, z = ((torch.tensor(cell) + 0.5) / 3 - 0.5) * box[3:6]
                cos, sin = torch.cos(box[6]), torch.sin(box[6])
                place = box[:3] + torch.stack([x * cos - y * sin, x * sin + y * cos, z])
                pooled[(r, slice(None), *cell)] = ball(head.roi_grid_pool_layer, xyz, rows, place)
        shared = conv_mlp(head.shared_fc_layer, pooled.view(10, -1, 1))
        torch.testing.assert_close(output.logits, conv_mlp(head.cls_layers, shared)[..., 0])
        residuals = conv_mlp(head.reg_layers, shared)[..., 0]
        torch.testing.assert_close(output.residuals, residuals)
    assert (pooled.flatten(2).std(dim=2) > 0).any(dim=1).all(), "balls with keypoints"
    # Sizes and yaw by hand.
    sizes = boxes.view(10, 7)[:, 3:6] * residuals[:, 3:6].exp()
    torch.testing.assert_close(refined.view(10, 7)[:, 3:6], sizes)
    torch.testing.assert_close(refined[..., 6].flatten(), boxes[..., 6].flatten() + residuals[:, 6])


def ball(module, xyz, features, place):
    """What a set abstraction makes of one place, as images of one row."""
    result = []
    for radius, samples, layers in zip(module.radii, module.samples, module.mlps, strict=True):
        near = ((xyz - place).norm(dim=1) < radius).nonzero().flatten()[:samples]
        rows = torch.zeros(1, 3 + features.shape[1]).double()
        if len(near):
            rows = torch.cat([xyz[near] - place, features[near]], dim=1)
        image = rows.t()[None, :, :, None]
        for layer in layers:
            if isinstance(layer, torch.nn.Conv2d):
                image = functional.conv2d(image, layer.weight)
            elif isinstance(layer, torch.nn.ReLU):
                image = layer(image)
            else:
                image = functional.batch_norm(
                    image, layer.running_mean, layer.running_var, layer.weight, layer.bias,
                    eps=layer.eps,
                )  # fmt: skip
        result.append(image.amax(dim=(0, 2, 3)))
    return torch.cat(result)


def batch():
    clouds, truth = scenes(2, seed=1, objects=8, fewest=5)
    frames = TrainingFrames(["Car"], clouds, truth, 0.0, 5)
    return as_tensors([frames[0], frames[1]])


def test_gradients_of_the_loss_are_finite_differences():
    """Of what lies behind the proposals: through those no gradient flows, as upstream."""
    torch.manual_seed(0)
    model = build_detector("pv_rcnn_tiny", ["Car"]).double().eval()
    for name, value in model.state_dict().items():
        if name.endswith(".bias"):  # at 0 the features of empty balls are on ReLU's edge
            value += 0.1 * torch.randn_like(value)
    data = batch()
    parts = [model.pfe, model.point_head, model.roi_head]
    parameters = [p for part in parts for p in part.parameters()]
    directions = [torch.randn_like(p) for p in parameters]

    def loss():
        torch.manual_seed(3)
        losses = model.loss(*data)
        assert losses["loss"].item() == pytest.approx(
            sum(losses[name].item() for name in (
                "classification", "location", "direction",
                "point_cls", "rcnn_cls", "rcnn_reg", "rcnn_corner",
            ))
        )  # fmt: skip
        return losses["loss"]

    gradients = torch.autograd.grad(loss(), parameters)
    slope = sum((g * d).sum().item() for g, d in zip(gradients, directions, strict=True))
    values = []
    step = 1e-7
    with torch.no_grad():
        for sign in (1, -1):
            for p, d in zip(parameters, directions, strict=True):
                p += sign * step * d
            values.append(loss().item())
            for p, d in zip(parameters, directions, strict=True):
                p -= sign * step * d
    assert slope == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-4)
    assert abs(slope) > 1e-2


def test_frames_do_not_see_each_other_and_selection_keeps_all_refined_boxes():
    torch.manual_seed(0)
    model = build_detector("pv_rcnn_tiny", CLASSES)
    clouds, _, _ = batch()
    together = model.predict(clouds, Selection(score=0.0, nms=0.1, post=5))
    for cloud, found in zip(clouds, together, strict=True):
        assert len(found["boxes"]) == 5
        assert found["refined"].shape == (model.roi_head.settings.test.post, 7)
        alone = model.predict([cloud], Selection(score=0.0, nms=0.1, post=5))[0]
        for name, value in alone.items():
            torch.testing.assert_close(value, found[name], rtol=1e-4, atol=1e-4)
    nothing = model.predict(clouds, Selection(score=1.0))[0]
    assert nothing["boxes"].shape == (0, 7)
    assert len(nothing["refined"]) == len(together[0]["refined"])


def test_the_papers_preset_differs_in_range_and_anchors_only():
    ours, theirs = (build_detector("pv_rcnn", CLASSES, preset=p) for p in ("paper", "openpcdet"))
    shapes = [
        {name: value.shape for name, value in model.state_dict().items()}
        for model in (ours, theirs)
    ]
    assert shapes[0] == shapes[1]
    assert ours.point_range == pytest.approx((0, -20, -3, 40, 20, 1))
    assert ours.dense_head.anchors[0, 0, ::2, 3:6].tolist() == [
        pytest.approx(size) for size in ((3.9, 1.6, 1.56), (0.7, 0.7, 1.5), (1.5, 0.9, 1.0))
    ]
