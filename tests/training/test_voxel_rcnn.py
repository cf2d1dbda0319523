"""Voxel R-CNN against OpenPCDet."""

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
from training.detectors.heads.proposals import Proposals
from training.detectors.heads.voxel_rcnn_head import NeighbourVoxelPool
from training.ops.sparse_conv import SparseTensor

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = reference("voxel_rcnn_car")


@pytest.fixture(scope="module")
def openpcdet():
    return network_and_first_stage("voxel_rcnn", DATA)


def test_first_stage_and_proposals_are_openpcdets(openpcdet):
    assert_first_stage_and_proposals_are_openpcdets(DATA, *openpcdet)


@pytest.mark.usefixtures("last_bits")
@torch.no_grad()
def test_second_stage_is_openpcdets(openpcdet):
    model, first = openpcdet
    rois = of_roi_head(DATA, "rois")
    output = model.second_stage(rois, first)
    logits = output.logits.view(*rois.shape[:2], 1)
    assert worst_error(DATA, "eval/roi_head/batch_cls_preds", logits) < 5e-6
    refined = model.roi_head.refine(output, rois)
    torch.testing.assert_close(refined, of_roi_head(DATA, "batch_box_preds"), rtol=1e-3, atol=1e-3)


@pytest.mark.usefixtures("last_bits")
@torch.no_grad()
def test_detections_are_openpcdets(openpcdet):
    """Given its RoIs, but for the order of boxes whose scores are the same to float noise."""
    model, first = openpcdet
    proposals = model.roi_head.propose(*model.dense_head.decode(first.head))
    proposals.boxes.copy_(of_roi_head(DATA, "rois"))
    output = model.second_stage(proposals.boxes, first)
    (detected,) = model.roi_head.detections(output, proposals, model.selection)
    boxes, scores = (torch.from_numpy(DATA[f"final_0/pred_{key}"]) for key in ("boxes", "scores"))
    assert len(detected["boxes"]) == len(boxes)
    torch.testing.assert_close(detected["scores"], scores, rtol=1e-5, atol=1e-6)
    assert (detected["labels"] == 1).all()
    assert detected["refined"].shape == (100, 7)
    close = torch.isclose(detected["boxes"][:, None], boxes, rtol=1e-3, atol=1e-2).all(dim=2)
    tied = torch.isclose(scores[:, None], scores, rtol=0, atol=1e-6).sum(dim=1) > 1
    missing = ~close.any(dim=0)
    assert missing.sum() <= 1
    assert tied[missing].all()


@pytest.mark.usefixtures("last_bits")
def test_pool_against_brute_force():
    torch.manual_seed(0)
    shape, reach, radius, samples = (4, 12, 12), (2, 2, 2), 1.7, 4
    sites = torch.nonzero(torch.rand(2, *shape) < 0.2)
    voxels = SparseTensor(torch.randn(len(sites), 5), sites, shape, 2)
    centres = sites[:, [3, 2, 1]] + 0.5
    cells = torch.stack([torch.randint(0, n, (60,)) for n in (2, *shape)], dim=1)
    places = cells[:, [3, 2, 1]] + torch.rand(60, 3)
    cells[0], places[0] = torch.tensor([0, 0, 40, 40]), torch.tensor([40.5, 40.5, 0.5])
    pool = NeighbourVoxelPool(5, (6, 7), radius, reach, samples).eval()
    for module in pool.modules():
        if isinstance(module, torch.nn.BatchNorm1d):
            torch.nn.init.normal_(module.running_mean)
            torch.nn.init.normal_(module.bias)
    pooled = pool(voxels, centres, places, cells)
    rows = pool.mlps_in[0](voxels.features)
    result = []
    for place, cell in zip(places, cells, strict=True):
        near = [
            i
            for i, site in enumerate(sites.tolist())
            if site[0] == cell[0]
            and all(abs(site[k + 1] - int(cell[k + 1])) <= reach[k] for k in range(3))
            and torch.dist(centres[i], place) < radius
        ][:samples]
        features = rows[near] if near else torch.zeros(1, 6)
        offsets = centres[near] - place if near else torch.zeros(1, 3)
        result.append((features + pool.mlps_pos[0](offsets)).relu().amax(dim=0))
    torch.testing.assert_close(pooled, pool.mlps_out[0](torch.stack(result)))


def test_losses_reach_all_parameters():
    torch.manual_seed(0)
    model = build_detector("voxel_rcnn_tiny", ["Car", "Cyclist"]).train()
    points, boxes, labels = batch()
    # Untrained, hardly a proposal would be near enough to an object to learn its box.
    model.roi_head.propose = lambda *_: propose_objects(boxes)
    losses = model.loss(points, boxes, labels)
    second = {"rcnn_cls", "rcnn_reg", "rcnn_corner"}
    assert set(losses) == {"loss", "classification", "location", "direction"} | second
    torch.testing.assert_close(2 * losses["loss"], torch.stack([*losses.values()]).sum())
    torch.stack([losses[name] for name in second]).sum().backward(retain_graph=True)
    # The second stage trains the sparse backbone too.
    assert model.backbone_3d.conv_input[0].weight.grad.abs().sum() > 0
    assert_all_parameters_learn(model, losses["loss"])


def propose_objects(boxes):
    """32 proposals around the objects of each frame."""
    random = np.random.default_rng(0)
    near = torch.stack([item[torch.arange(32) % len(item)] for item in boxes])
    near = near + torch.from_numpy(random.normal(0, 0.1, near.shape)).float()
    return Proposals(near, torch.zeros(2, 32), torch.ones(2, 32, dtype=torch.int64))
