"""SECOND-IoU against OpenPCDet."""

import math

import numpy as np
import pytest
import torch

from tests.training.anchor_reference import (
    assert_first_stage_and_proposals_are_openpcdets,
    network_and_first_stage,
)
from tests.training.openpcdet_reference import of_roi_head, reference, worst_error
from tests.training.synthetic_scenes import assert_all_parameters_learn, batch
from training import build_detector
from training.detectors.heads.second_iou_head import bev_pool
from training.ops.rotated_iou import iou_bev

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = reference("second_iou")
CLASSES = ("Car", "Pedestrian", "Cyclist")


@pytest.fixture(scope="module")
def openpcdet():
    return network_and_first_stage("second_iou", DATA)


def test_first_stage_and_proposals_are_openpcdets(openpcdet):
    assert_first_stage_and_proposals_are_openpcdets(DATA, *openpcdet)


@pytest.mark.usefixtures("last_bits")
@torch.no_grad()
def test_second_stage_is_openpcdets(openpcdet):
    model, first = openpcdet
    rois = of_roi_head(DATA, "rois")
    output = model.second_stage(rois, first)
    logits = output.logits.view(*rois.shape[:2], 1)
    assert worst_error(DATA, "eval/roi_head/batch_cls_preds", logits) < 2e-5
    assert torch.equal(model.roi_head.refine(output, rois), of_roi_head(DATA, "batch_box_preds"))


@pytest.mark.usefixtures("last_bits")
@torch.no_grad()
def test_detections_are_openpcdets(openpcdet):
    """Given its RoIs. Its float32 kernel finds too much overlap of boxes a few millimetres wide."""
    model, first = openpcdet
    proposals = model.roi_head.propose(*model.dense_head.decode(first.head))
    proposals.boxes.copy_(of_roi_head(DATA, "rois"))
    output = model.second_stage(proposals.boxes, first)
    for b, detected in enumerate(model.roi_head.detections(output, proposals, model.selection)):
        expected = {
            key: torch.from_numpy(DATA[f"final_{b}/pred_{key}"]) for key in ("boxes", "labels")
        }
        score = torch.from_numpy(DATA[f"final_{b}/pred_iou_scores"])
        same = (detected["boxes"][:, None] == expected["boxes"]).all(dim=2)
        assert same.any(dim=0).all()
        row = same.int().argmax(dim=0)
        assert torch.equal(detected["labels"][row], expected["labels"])
        torch.testing.assert_close(detected["scores"][row], score, rtol=1e-4, atol=1e-5)
        assert (detected["scores"].diff() <= 0).all()
        extra = detected["boxes"][~same.any(dim=1)]
        assert len(extra) <= 2
        for box in extra:
            others = expected["boxes"][iou_bev(box[None].numpy(), expected["boxes"].numpy())[0] > 0]
            assert torch.cat([box[None], others])[:, 3:5].min() < 0.01


def test_pooling_by_hand():
    corner, cell = (0.0, -8.0), 2.0
    y, x = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
    image = torch.stack([x, y])[None]  # in cells
    rois = torch.tensor([[[6.0, 0.0, 1.0, 4.0, 4.0, 2.0, 0.0], [6.0, 0.0, 1, 4.0, 4.0, 2.0, 0.5]]])
    pooled = bev_pool(image, rois, corner, cell, 3)
    assert pooled.shape == (2, 2, 3, 3)
    torch.testing.assert_close(pooled[0, 0, 1], torch.tensor([2.0, 3.0, 4.0]))
    torch.testing.assert_close(pooled[0, 1, :, 1], torch.tensor([3.0, 4.0, 5.0]))
    ahead = torch.tensor([3.0 + math.cos(0.5), 4.0 + math.sin(0.5)])
    torch.testing.assert_close(pooled[1, :, 1, 2], ahead)
    outside = rois + torch.tensor([100.0, 0, 0, 0, 0, 0, 0])
    assert (bev_pool(image, outside, corner, cell, 3) == 0).all()


def test_the_head_knows_the_cells_of_its_image():
    """Pooled from an image of coordinates, a RoI without yaw finds its own places."""
    model = build_detector("second_iou_tiny", ["Car"])
    head = model.roi_head
    with torch.no_grad():
        image = model.eval().first_stage([torch.zeros(0, 4)]).image
    ny, nx = image.shape[2:]
    low, high = np.array(model.point_range[:2]), np.array(model.point_range[3:5])
    np.testing.assert_allclose((high - low) / head.cell, [nx, ny])
    y, x = torch.meshgrid(torch.arange(ny), torch.arange(nx), indexing="ij")
    places = torch.stack([x, y])[None] * head.cell + torch.tensor(head.corner)[None, :, None, None]
    roi = torch.tensor([[[30.0, 10.0, 0.0, 4.0, 2.0, 1.5, 0.0]]])
    pooled = bev_pool(places.float(), roi, head.corner, head.cell, 3)[0]
    torch.testing.assert_close(pooled[0], torch.tensor([28.0, 30.0, 32.0]).expand(3, 3))
    torch.testing.assert_close(pooled[1], torch.tensor([9.0, 10.0, 11.0])[:, None].expand(3, 3))


def test_losses_reach_all_parameters():
    torch.manual_seed(0)
    model = build_detector("second_iou_tiny", CLASSES).train()
    losses = model.loss(*batch())
    assert set(losses) == {"loss", "classification", "location", "direction", "rcnn_cls"}
    parts = losses["classification"] + losses["location"] + losses["direction"]
    torch.testing.assert_close(losses["loss"], parts + losses["rcnn_cls"])
    losses["rcnn_cls"].backward(retain_graph=True)
    # As in OpenPCDet: the second stage does not train the first.
    assert all(p.grad is None for n, p in model.named_parameters() if "roi_head" not in n)
    assert_all_parameters_learn(model, losses["loss"])
