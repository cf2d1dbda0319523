import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace import (
    PAPER_PLACEMENTS,
    Lidar,
    Mount,
    OccupancyGrid,
    Placement,
    Roi,
    evaluate,
    evaluate_classes,
)

DATA = Path(__file__).parents[1] / "data/smig"
GOLDEN = json.loads((DATA / "golden.json").read_text())
ROI = Roi(x=(0.0, 3.0), y=(-1.5, 1.5), z=(0.0, 2.0), resolution=0.25)
LIDAR = Lidar(tuple(np.radians([-40.0, -20.0, -3.0, 5.0])), azimuth_steps=90)
PLACEMENT = PAPER_PLACEMENTS["line_roll"].with_lidar(LIDAR)


@pytest.fixture(scope="module")
def golden_grids():
    boxes = pd.read_csv(DATA / "boxes.csv")
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=GOLDEN["resolution"])
    return {
        name: OccupancyGrid.from_boxes(boxes, roi, name, GOLDEN["frames"])
        for name in GOLDEN["classes"]
    }


def test_pog_agrees_with_reference(golden_grids):
    for name, expected in GOLDEN["classes"].items():
        grid = golden_grids[name]
        assert grid.h_pog == pytest.approx(expected["h_pog"], rel=1e-12)
        assert np.count_nonzero(grid.counts) == expected["nonzero"]
        assert int(grid.counts.sum()) == expected["count_sum"]


@pytest.mark.parametrize("placement", GOLDEN["placements"])
def test_s_mig_agrees_with_reference(golden_grids, placement):
    mounts = [Mount(*row) for row in GOLDEN["placements"][placement]]
    results = evaluate_classes(golden_grids, Placement(placement, mounts, lidar=Lidar.paper()))
    for name, result in results.items():
        expected = GOLDEN["classes"][name]["placements"][placement]
        assert result.s_mig == pytest.approx(expected["s_mig"], rel=1e-12)
        assert result.covered_nonzero == expected["covered_nonzero"]
        assert result.ig == pytest.approx(result.h_pog + result.s_mig, rel=1e-15)
        assert result.residual_entropy == pytest.approx(result.h_pog - result.covered_entropy)
        assert result.m_sog == pytest.approx(result.s_mig / result.covered_voxels)


@pytest.fixture(scope="module")
def grid():
    counts = np.random.default_rng(1).integers(0, 51, ROI.shape).astype(np.int32)
    counts[counts > 30] = 0
    return OccupancyGrid(ROI, "Car", counts, 50)


def test_occlusion_hides(grid):
    q, placement = 0.3, PLACEMENT
    with_occlusion = evaluate(
        grid, placement, surrogates=["expected_ig"], detection_probability=q, occlusion=True
    )
    without = evaluate(grid, placement, surrogates=["expected_ig"], detection_probability=q)
    assert 0 < with_occlusion.expected_ig < without.expected_ig


def test_limits_of_expected_ig(grid):
    """A sensor that never misses learns the whole entropy of what its rays pass."""
    result = evaluate(
        grid, PLACEMENT, method="dda", surrogates=["expected_ig"], detection_probability=1.0
    )
    assert result.expected_ig == pytest.approx(result.covered_entropy, rel=1e-12)


def test_azimuth_steps_override_the_lidars_own(grid):
    few = evaluate(grid, PLACEMENT, method="dda", azimuth_steps=8)
    many = evaluate(grid, PLACEMENT, method="dda", azimuth_steps=800)
    assert few.covered_voxels < many.covered_voxels
    assert evaluate(grid, PLACEMENT, azimuth_steps=8).s_mig == evaluate(grid, PLACEMENT).s_mig


def test_a_placement_that_sees_nothing(grid):
    up = Placement("up", [Mount(z=3.0)], lidar=Lidar((0.5,), 90))
    result = evaluate(grid, up, surrogates=["expected_points", "expected_ig"])
    assert result.s_mig == 0.0
    assert math.isnan(result.m_sog)
    assert result.expected_points == result.expected_ig == 0.0
