"""SECOND and what all voxel networks share: against OpenPCDet, voxels, mixed precision."""

import numpy as np
import pytest
import torch

from tests.training.anchor_reference import (
    assert_first_stage_is_openpcdets,
    assert_head_is_openpcdets,
    assert_training_is_openpcdets,
)
from tests.training.openpcdet_reference import points, reference, weights
from tests.training.synthetic_scenes import batch
from training import build_detector
from training.detectors.backbones.voxels import VoxelGrid, voxelise

DATA = reference("second")
CLASSES = ("Car", "Pedestrian", "Cyclist")
CPU = torch.device("cpu")

pytestmark = pytest.mark.usefixtures("one_thread")


def test_voxels_are_openpcdets():
    grid = build_detector("second", CLASSES).grid
    voxels = voxelise(points(DATA), grid, False, CPU).features
    assert voxels.shape == tuple(DATA["eval/vfe/voxel_features/shape"])
    total = voxels.double().sum().item()
    assert total == pytest.approx(DATA["eval/vfe/voxel_features/sum"], rel=1e-9)


@pytest.mark.long
def test_everything_is_openpcdets():
    """Outputs of all stages, detections, losses, gradients.

    Others compare the first stage (test_second_iou), and an anchor head (test_pointpillars).
    """
    model = build_detector("second", CLASSES)
    model.load_state_dict(weights(model.state_dict(), DATA))
    model.eval()
    stage = model.first_stage(points(DATA))
    assert_first_stage_is_openpcdets(DATA, stage)
    assert_head_is_openpcdets(model, DATA, stage.head)
    # In float64 the norms agree to 3e-4; in float32 ReLUs that flip by rounding add noise.
    assert_training_is_openpcdets(model, DATA, stage.head, tolerance=4e-3)


def test_voxels_by_hand():
    grid = VoxelGrid(
        (0.0, 0.0, 0.0, 2.0, 1.0, 1.0), (1.0, 1.0, 0.5), max_points=2, max_voxels=(1, 2)
    )
    # The fourth is the third of its voxel, the fifth makes a third voxel; then those outside, three
    # of them on the far faces.
    x = [1.5, 0.5, 1.1, 1.1, 0.5, 0.5, 2.0, 0.5, torch.nan, 0.5]
    y = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0, 0.5, 0.5]
    z = [0.1, 0.9, 0.3, 0.2, 0.1, 1.0, 0.5, 0.5, 0.5, 0.5]
    light = [0.0, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5, 0.5, 0.5, torch.inf]
    cloud = torch.tensor([x, y, z, light]).T
    batch = voxelise([cloud, cloud[:0], cloud], grid, False, CPU)
    assert batch.shape == (3, 1, 2)
    assert batch.coordinates.tolist() == [[0, 0, 0, 1], [0, 1, 0, 0], [2, 0, 0, 1], [2, 1, 0, 0]]
    expected = torch.tensor([[1.3, 0.5, 0.2, 0.1], [0.5, 0.5, 0.9, 0.1]] * 2)
    torch.testing.assert_close(batch.features, expected)
    assert voxelise([cloud], grid, True, CPU).coordinates.tolist() == [[0, 0, 0, 1]]
    # The near faces are inside.
    assert len(voxelise([torch.zeros(1, 4)], grid, True, CPU).features) == 1


def test_voxels_are_those_of_a_sort():
    random = np.random.default_rng(0)
    cloud = random.uniform((-1, -1, -1, 0), (9, 9, 5, 1), (20_000, 4)).astype(np.float32)
    grid = VoxelGrid((0.0, 0.0, 0.0, 8.0, 8.0, 4.0), (0.25, 0.5, 1.0))
    cell = np.floor(cloud[:, :3] / np.array(grid.size, np.float32)).astype(int)[:, ::-1]
    inside = ((cell >= 0) & (cell < grid.cells)).all(axis=1)
    cells, place, counts = np.unique(cell[inside], axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(cells), 4))
    np.add.at(sums, place, cloud[inside])
    batch = voxelise([torch.from_numpy(cloud)], grid, True, CPU)
    assert np.array_equal(batch.coordinates[:, 1:].numpy(), cells)
    np.testing.assert_allclose(batch.features, sums / counts[:, None], rtol=1e-6)


def test_losses_of_other_precisions_are_near():
    torch.manual_seed(0)
    model, frames = build_detector("second_tiny", ["Car"]).train(), batch()
    plain = model.loss(*frames)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = model.loss(*frames)
    for key, value in mixed.items():
        assert value.dtype == torch.float32
        assert value.item() == pytest.approx(plain[key].item(), rel=0.05)
    double = model.double().loss(*frames)
    assert double["loss"].dtype == torch.float64
    assert double["loss"].item() == pytest.approx(plain["loss"].item(), rel=1e-4)


def test_range_grows_to_whole_cells():
    model = build_detector("second", CLASSES, point_range=(0, -20, 0, 40.1, 20, 4))
    assert model.point_range == pytest.approx((0, -20, -3, 40.8, 20, 1))
    assert model.grid.shape == (41, 800, 816)
    assert model.dense_head.anchors.shape[:2] == (100, 102)
    paper = build_detector("second_paper", CLASSES)
    assert paper.point_range == (0, -20, -3, 40, 20, 1)
    model.load_state_dict(paper.state_dict())
