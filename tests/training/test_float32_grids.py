"""Grids to the bit as OpenPCDet computes them: its range is float32, its cell sizes are not."""

import math
from fractions import Fraction

import numpy as np
import pytest
import torch

from tests.training.other_device import other_device
from training import build_detector
from training.detectors.backbones.pillars import PillarGrid, group
from training.detectors.backbones.voxels import VoxelGrid, voxelise
from training.detectors.heads.anchors import KITTI_ANCHORS, anchor_grid
from training.detectors.heads.voxel_rcnn_head import cells_of

CLASSES = ("Car", "Pedestrian", "Cyclist")


def upstream_anchors(point_range, shape, classes, centred):
    """AnchorGenerator.generate_anchors, one anchor after the other; (ny, nx, K, 7)."""
    anchor_range = np.array(point_range, np.float32)
    cells = np.array(shape) if centred else np.array(shape) - 1
    stride = (anchor_range[3:5] - anchor_range[:2]).astype(np.float64) / cells
    offset = stride / 2 if centred else 0 * stride
    starts, stops = anchor_range[:2].astype(float) + offset, anchor_range[3:5].astype(float) + 1e-5
    steps = zip(starts, stops, stride, strict=True)
    x, y = (torch.arange(*step, dtype=torch.float32).numpy() for step in steps)
    assert (len(x), len(y)) == shape
    anchors = np.empty((len(y), len(x), 2 * len(classes), 7), np.float32)
    anchors[..., 0], anchors[..., 1] = x[:, None], y[:, None, None]
    for k, item in enumerate(classes):
        for r, rotation in enumerate(item.rotations):
            anchors[:, :, 2 * k + r, 2] = item.bottom
            anchors[:, :, 2 * k + r, 3:6] = item.size
            anchors[:, :, 2 * k + r, 6] = rotation
    anchors[..., 2] += anchors[..., 5] / 2
    return anchors


@pytest.mark.parametrize("network", ["pointpillars", "second", "second_iou", "pv_rcnn"])
def test_anchors_of_the_networks(network):
    model = build_detector(network, CLASSES)
    anchors = model.dense_head.anchors.numpy()
    shape = anchors.shape[1], anchors.shape[0]
    classes = [KITTI_ANCHORS[name] for name in CLASSES]
    expected = upstream_anchors(model.point_range, shape, classes, centred=False)
    assert np.array_equal(anchors, expected)


@pytest.mark.parametrize("centred", [False, True])
def test_anchors_of_any_range(centred):
    classes = [KITTI_ANCHORS[name] for name in CLASSES]
    for low in (-39.68, -0.1, 3.3):
        point_range = (low, low - 7, -3.0, low + 28.8, low + 12.2, 1.0)
        anchors = anchor_grid(classes, point_range, (90, 60), centred).numpy()
        expected = upstream_anchors(point_range, (90, 60), classes, centred)
        assert np.array_equal(anchors, expected)


@pytest.mark.parametrize(("max_points", "max_cells"), [(None, None), (2, (40, 70)), (1, (5, 9))])
def test_a_gpu_groups_points_as_the_cpu(max_points, max_cells):
    """Voxels and pillars to the bit, with frames that have no point inside."""
    torch.manual_seed(0)
    few, many = torch.rand(600, 4) * 10 - 1, torch.rand(3000, 4) * 10 - 1
    few[5:9], few[11, 3] = 8.0, torch.inf
    none, outside = torch.zeros(0, 4), torch.full((3, 4), torch.nan)
    space = (0.0, 0.0, 0.0, 8.0, 8.0, 4.0)
    voxels = VoxelGrid(space, (0.5, 1.0, 1.0), max_points, max_cells)
    pillars = PillarGrid(space, (0.5, 1.0), max_points, max_cells)
    with other_device() as place:
        for frames in ([few, none, many, outside], [none], [outside]):
            expected, ours = (
                (voxelise(frames, voxels, True, device), group(frames, pillars, True, device))
                for device in (torch.device("cpu"), place)
            )
            for name in ("features", "coordinates"):
                assert torch.equal(getattr(ours[0], name).cpu(), getattr(expected[0], name))
            for name in ("points", "pillar", "counts", "cells"):
                assert torch.equal(getattr(ours[1], name).cpu(), getattr(expected[1], name))
    assert len(expected[0].features) == 0


def test_offsets_from_the_centres_of_pillars():
    low, size = -79.88, 0.16  # where -79.8 in float32 depends on the order of rounding
    grid = PillarGrid((low, low, 0.0, low + 10 * size, low + 10 * size, 4.0), (size, size))
    cloud = torch.tensor([[low + 0.5, low + 0.9, 1.0, 0.0]])
    batch = group([cloud], grid, training=False, device=torch.device("cpu"))
    # PillarVFE: an index times the size, plus half a size from the corner.
    corner = torch.from_numpy(np.array([low, low, 0.0], np.float32)).tolist()
    expected = torch.tensor([3.0, 5.0]) * size + (size / 2 + corner[0])
    assert torch.equal(grid.centres(batch.cells)[0, :2], expected)


def test_voxels_of_places_on_their_faces():
    """VoxelRCNNHead's are those of a floor division, which no rounded quotient lifts."""
    edge = np.float32(0.05)
    x = edge * np.arange(-500, 500, dtype=np.float32)
    cells = cells_of(torch.from_numpy(x)[:, None].expand(-1, 3), torch.tensor([edge] * 3))
    expected = [math.floor(Fraction(float(v)) / Fraction(float(edge))) for v in x]
    assert cells[:, 0].tolist() == expected
    assert cells_of(torch.tensor([[1e30, -1e30, 0.0]]), torch.ones(3)).tolist() == [
        [1_000_000, -1_000_000, 0]
    ]
