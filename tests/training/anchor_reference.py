"""Compare a detector with one anchor head with OpenPCDet's: outputs, detections, training."""

import numpy as np
import pytest
import torch

from tests.training.openpcdet_reference import of_roi_head, points, weights, worst_error
from training import build_detector
from training.detectors.heads.selection import select_boxes

LOSSES = ("loss", "rpn_loss_cls", "rpn_loss_loc", "rpn_loss_dir")  # openPCDet's names of our losses


def network_and_first_stage(network, data):
    """A voxel network with OpenPCDet's weights, and its first stage of the reference's frames."""
    model = build_detector(network, [str(name) for name in data["classes"]]).eval()
    model.load_state_dict(weights(model.state_dict(), data))
    with torch.no_grad():
        return model, model.first_stage(points(data))


def assert_first_stage_is_openpcdets(data, first):
    """Sites and features of the sparse backbone, the grid from above, the 2D backbone's image."""
    encoded = first.scales["encoded"]
    name = "eval/backbone_3d/encoded_spconv_tensor"
    assert encoded.shape == tuple(data[f"{name}/spatial_shape"])
    assert np.array_equal(encoded.coordinates.numpy(), data[f"{name}/coordinates"])
    assert worst_error(data, f"{name}/features", encoded.features) < 1e-5
    assert worst_error(data, "eval/map_to_bev_module/spatial_features", first.bev) < 1e-5
    assert worst_error(data, "eval/backbone_2d/spatial_features_2d", first.image) < 1e-4


@torch.no_grad()
def assert_first_stage_and_proposals_are_openpcdets(data, model, first):
    """And scores, labels and boxes of the proposals."""
    assert_first_stage_is_openpcdets(data, first)
    logits, anchors = model.dense_head.decode(first.head)
    assert worst_error(data, "eval/dense_head/batch_cls_preds", logits) < 2e-4
    assert worst_error(data, "eval/dense_head/batch_box_preds", anchors) < 2e-4
    proposals = model.roi_head.propose(logits, anchors)
    boxes, scores = of_roi_head(data, "rois"), of_roi_head(data, "roi_scores")
    assert torch.equal(proposals.labels, of_roi_head(data, "roi_labels"))
    assert worst_error(data, "eval/roi_head/rois", proposals.boxes) < 1e-3
    torch.testing.assert_close(proposals.scores, scores, rtol=5e-5, atol=1e-5)
    # Sizes are exponentials of numbers up to 50, so noise is relative.
    torch.testing.assert_close(proposals.boxes, boxes, rtol=1e-3, atol=1e-3)


def assert_head_is_openpcdets(model, data, output):
    """Raw outputs, decoded boxes, detections."""
    logits, boxes = model.dense_head.decode(output)
    residuals, directions = model.dense_head.raw_boxes(output)
    selected = {
        "raw/dense_head/cls_preds": output.logits,
        "raw/dense_head/box_preds": residuals,
        "raw/dense_head/dir_cls_preds": directions,
        "eval/dense_head/batch_cls_preds": logits,
        "eval/dense_head/batch_box_preds": boxes,
    }
    assert all(worst_error(data, *item) < 1e-4 for item in selected.items())
    for frame in range(len(logits)):
        scores = logits[frame].sigmoid()
        theirs = _rows(*(data[f"final_{frame}/pred_{name}"] for name in _COLUMNS))
        if len(np.unique(theirs[:, 7])) > len(theirs) / 2:
            (selected,) = select_boxes(logits[frame, None], boxes[frame, None], model.selection)
            ours = _rows(*(selected[name].detach() for name in _COLUMNS))
            assert len(ours) == len(theirs)
        else:
            # Most scores are exactly 1, and the order of equal scores is chance on either side.
            best, label = scores.max(dim=1)
            ours = _rows(boxes[frame].detach(), best.detach(), label + 1)
            ours = ours[ours[:, 7] > theirs[:, 7].min() - 1e-4]
        # Scores that differ by rounding alone may change places.
        error = [np.abs((ours - row) / (1 + np.abs(row))).max(axis=1).min() for row in theirs]
        assert max(error) < 1e-3


_COLUMNS = ("boxes", "scores", "labels")


def _rows(boxes, scores, labels):
    return np.column_stack([boxes, scores, labels]).astype(np.float64)


def assert_training_is_openpcdets(model, data, output, tolerance):
    """Targets, losses, and norms of the gradients up to a relative `tolerance`."""
    boxes = torch.from_numpy(data["gt_boxes"])
    targets = model.dense_head.targets(boxes[..., :7], boxes[..., 7].long())
    labels = targets.labels.flatten()
    total, rows, values = (data[f"train/box_cls_labels/{n}"] for n in ("sum", "index", "value"))
    assert labels.sum() == total
    assert labels[torch.from_numpy(rows)].tolist() == values.tolist()
    losses = model.dense_head.loss(output, targets)
    for value, name in zip(losses.values(), LOSSES, strict=True):
        assert value.item() == pytest.approx(float(data[f"train/{name}"]), rel=1e-5)
    model.zero_grad()
    losses["loss"].backward()
    norms = {key: value.grad.norm().item() for key, value in model.named_parameters()}
    expected = dict(zip(data["train/grad_keys"].tolist(), data["train/grad_norms"], strict=True))
    assert norms == pytest.approx(expected, rel=tolerance)
