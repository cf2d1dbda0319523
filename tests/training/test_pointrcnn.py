"""PointRCNN and PointRCNN-IoU against OpenPCDet."""

import math
from dataclasses import replace

import pytest
import torch

from tests.training.openpcdet_reference import of_roi_head, points, reference, weights, worst_error
from tests.training.synthetic_scenes import batch
from training import build_detector
from training.detectors.heads.pointrcnn_head import ScoredPoints
from training.detectors.heads.proposals import Proposals
from training.detectors.heads.roi_head import RoiOutput

CLASSES = ("Car", "Pedestrian", "Cyclist")
NETWORKS = ("pointrcnn", "pointrcnn_iou")

pytestmark = pytest.mark.usefixtures("one_thread")


def of_second_stage(data):
    names = ("rois", "roi_scores", "roi_labels", "batch_cls_preds", "batch_box_preds")
    return {name: of_roi_head(data, name) for name in names}


@pytest.mark.parametrize(
    "network", ["pointrcnn", pytest.param("pointrcnn_iou", marks=pytest.mark.long)]
)
@pytest.mark.usefixtures("last_bits")
@torch.no_grad()
def test_stages_are_openpcdets(network):
    data = reference(network)
    expected = of_second_stage(data)
    model = build_detector(network, CLASSES)
    model.load_state_dict(weights(model.state_dict(), data))
    model.eval()
    scored, output = model.first_stage(points(data))
    proposals = model.propose(scored, output)
    of_given_rois = model.roi_head(expected["rois"], scored)
    given_boxes = model.roi_head.refine(of_given_rois, expected["rois"])
    frame = torch.zeros(len(scored.xyz), 1)
    for name, value, tolerance in (
        ("eval/backbone_3d/point_coords", torch.cat([frame, scored.xyz], dim=1), 0),
        ("eval/backbone_3d/point_features", scored.features, 2e-5),
        ("raw/point_head/point_cls_preds", output.logits, 1e-4),
        ("raw/point_head/point_box_preds", output.residuals, 1e-4),
        ("eval/point_head/point_cls_scores", scored.scores, 1e-4),
        ("eval/point_head/batch_box_preds", model.point_head.decode(output, scored.xyz), 1e-4),
        ("eval/roi_head/rois", proposals.boxes, 1e-4),
        ("eval/roi_head/roi_scores", proposals.scores, 1e-4),
        ("eval/roi_head/roi_labels", proposals.labels, 0),
        # Of the same RoIs the second stage takes the same points on every machine.
        ("eval/roi_head/batch_cls_preds", of_given_rois.logits[None], 1e-3),
        ("eval/roi_head/batch_box_preds", given_boxes, 1e-3),
    ):
        assert worst_error(data, name, value) <= tolerance, name
    # The largest box is 4 km long: small ones need a comparison of their own.
    torch.testing.assert_close(given_boxes, expected["batch_box_preds"], rtol=5e-3, atol=5e-3)


@pytest.mark.usefixtures("last_bits")
@pytest.mark.parametrize("network", NETWORKS)
def test_detections_are_openpcdets(network):
    data = reference(network)
    stage = of_second_stage(data)
    final = torch.from_numpy(data["final_0/pred_boxes"])
    # RoIs without points score the same, and upstream's order of equal scores is that of its sort:
    # those that it survived come first here.
    survived = (stage["batch_box_preds"][0][:, None] == final).all(dim=2).any(dim=1)
    assert survived.sum() == len(final)
    logits = stage["batch_cls_preds"][0] + 1e-5 * survived[:, None]
    model = build_detector(network, CLASSES)
    head, boxes = model.roi_head, stage["batch_box_preds"]
    proposals = Proposals(boxes, stage["roi_scores"], stage["roi_labels"])
    output = RoiOutput(logits, torch.zeros(len(logits), 7))
    detected = head.detections(output, proposals, model.selection)[0]
    assert len(detected["boxes"]) == len(final)
    nearest = torch.cdist(final.double(), detected["boxes"].double()).argmin(dim=1)
    assert nearest.unique().numel() == len(final)
    torch.testing.assert_close(detected["boxes"][nearest], final, rtol=1e-4, atol=1e-4)
    scores = torch.from_numpy(data["final_0/pred_scores"])
    torch.testing.assert_close(detected["scores"], scores, rtol=0, atol=1e-5)
    labels = torch.from_numpy(data["final_0/pred_labels"])
    assert torch.equal(detected["labels"][nearest], labels)
    assert len(detected["refined"]) == boxes.shape[1]


def test_pooled_points_are_in_the_frame_of_their_proposal():
    head = build_detector("pointrcnn", CLASSES).roi_head
    xyz = torch.tensor([[10.0, 6.0, 1.0], [50.0, 0.0, 0.0], [9.5, 5.0, 0.5], [0.0, 0.0, 0.0]])
    scored = ScoredPoints(
        xyz, [3, 1], torch.arange(8.0).view(4, 2), torch.tensor([0.1, 0.2, 0.3, 0.4])
    )
    rois = torch.tensor([[10.0, 5.0, 1.0, 4.0, 2.0, 2.0, math.pi / 2], [30, 0, 0, 4, 2, 2, 0]])
    pooled = head.pool(torch.stack([rois, rois]), scored)
    assert pooled.shape == (4, 512, 7)
    depth = torch.tensor([10.0, 6.0, 1.0]).norm().item() / 70 - 0.5
    torch.testing.assert_close(
        pooled[0, 0], torch.tensor([1.0, 0.0, 0.0, 0.1, depth, 0.0, 1.0]), atol=1e-5, rtol=1e-5
    )
    torch.testing.assert_close(pooled[0, 1, :4], torch.tensor([0.0, 0.5, -0.5, 0.3]))
    assert torch.equal(pooled[0, 2:4], pooled[0, :2])
    assert (pooled[1:] == 0).all()  # no point, or only in the other frame


def test_losses_and_where_their_gradients_go():
    torch.manual_seed(0)
    model = build_detector("pointrcnn_tiny", ["Car"]).double().train()
    losses = model.loss(*batch(seed=1))
    parts = {"point_cls", "point_box", "rcnn_cls", "rcnn_reg", "rcnn_corner"}
    assert set(losses) == {"loss", *parts}
    assert losses["loss"].dtype == torch.float64
    assert losses["loss"].item() == pytest.approx(sum(losses[name].item() for name in parts))
    second = sum(losses[name] for name in parts if name.startswith("rcnn"))
    second.backward(retain_graph=True)
    assert all(p.grad is None for p in model.backbone_3d.parameters())
    assert all(p.grad.isfinite().all() for p in model.roi_head.parameters())
    losses["loss"].backward()
    assert all(p.grad.abs().sum() > 0 for p in model.backbone_3d.parameters() if p.ndim > 1)


def test_only_the_scores_targets_tell_the_two_apart():
    plain, iou = (build_detector(name, CLASSES).roi_head.settings for name in NETWORKS)
    assert (plain.sampling.score, iou.sampling.score) == ("cls", "roi_iou")
    assert replace(iou, sampling=plain.sampling) == plain
