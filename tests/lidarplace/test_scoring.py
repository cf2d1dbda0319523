import math

import numpy as np
import pytest

from lidarplace import (
    PAPER_PLACEMENTS,
    Lidar,
    Mount,
    Placement,
    Roi,
    evaluate,
    evaluate_classes,
    evaluate_many,
    expected_ig_by_q,
    sum_over_classes,
)
from lidarplace.coverage import count_covered
from lidarplace.coverage.rays import ray_counts
from lidarplace.pog.surrogates.evaluate import FAINT_Q, linear_share
from tests.lidarplace.random_grids import random_grids

ROI = Roi(x=(0.0, 6.0), y=(-3.0, 3.0), z=(0.0, 2.0), resolution=0.2)
LIDAR = Lidar(tuple(np.radians([-40.0, -20.0, -3.0, 5.0])), azimuth_steps=360)
NAMES = ("expected_points", "expected_ig")


@pytest.fixture(scope="module")
def grids():
    return random_grids(ROI)


def numbers(result):
    names = ("h_pog", "covered_entropy", "m_sog", "covered_voxels", *NAMES)
    return {name: getattr(result, name) for name in names}


def test_many_placements_are_scored_as_one_by_one(grids):
    placements = [placement.with_lidar(LIDAR) for placement in PAPER_PLACEMENTS.values()]
    many = evaluate_many(grids, placements, surrogates=NAMES)
    for placement, results in zip(placements, many, strict=True):
        alone = evaluate_classes(grids, placement, surrogates=NAMES)
        assert {c: numbers(r) for c, r in results.items()} == {
            c: numbers(r) for c, r in alone.items()
        }
        assert results["Car"].placement is placement


@pytest.mark.parametrize("method", ["cone", "dda", "bresenham"])
def test_covered_voxels_are_those_of_the_whole_roi(grids, method):
    placement = PAPER_PLACEMENTS["pyramid_roll"].with_lidar(LIDAR)
    results = evaluate_classes(grids, placement, method)
    covered = count_covered(placement, ROI, method)
    assert {r.covered_voxels for r in results.values()} == {covered}
    for result in results.values():
        assert result.m_sog == result.s_mig / covered
        assert result.covered_nonzero < covered


def test_the_sum_over_classes(grids):
    placement = PAPER_PLACEMENTS["line_roll"].with_lidar(LIDAR)
    results = evaluate_classes(grids, placement, surrogates=NAMES)
    total = sum_over_classes(results)
    for name in ("s_mig", "ig", "h_pog", "residual_entropy", *NAMES):
        expected = math.fsum(getattr(r, name) for r in results.values())
        assert getattr(total, name) == pytest.approx(expected, rel=1e-14)
    assert total.covered_voxels == results["Car"].covered_voxels
    assert total.m_sog == total.s_mig / total.covered_voxels
    assert sum_over_classes(evaluate_classes(grids, placement)).expected_ig is None
    other = evaluate(grids["Pedestrian"], PAPER_PLACEMENTS["line"])
    with pytest.raises(ValueError, match="one placement, ROI and method"):
        sum_over_classes({"Car": results["Car"], "Pedestrian": other})


def test_expected_ig_for_many_q_is_that_of_each(grids):
    placement = PAPER_PLACEMENTS["pyramid"].with_lidar(LIDAR)
    qs = [1e-9, 0.003, 0.1, 1.0]
    by_q = expected_ig_by_q(grids, placement, qs)
    assert list(by_q.columns) == qs
    assert list(by_q.index) == list(grids)
    for q in qs:
        alone = evaluate_classes(
            grids, placement, "dda", surrogates=["expected_ig"], detection_probability=q
        )
        for name, result in alone.items():
            assert by_q.loc[name, q] == pytest.approx(result.expected_ig, rel=1e-12)
    assert (by_q.diff(axis=1).iloc[:, 1:] > 0).all(axis=None)


def test_linear_share_is_that_of_rays_that_count_by_themselves(grids):
    """By the formula, ray by ray; near 1 for few faint rays, near 0 where many rays see all."""
    for steps, q, low, high in (
        (12, 1e-3, 0.99, 1.001),
        (360, 0.1, 0.1, 0.9),
        (7200, 0.9, 0.0, 0.1),
    ):
        placement = PAPER_PLACEMENTS["line"].with_lidar(Lidar(LIDAR.elevations, steps))
        shares = linear_share(expected_ig_by_q(grids, placement, [q, FAINT_Q]), q)
        rays = ray_counts(placement, ROI, "dda")
        for name, grid in grids.items():
            p = grid.probability
            each = np.where(p > 0, -p * np.log(np.where(p > 0, p, 1)), 0)  # I / q as q goes to 0
            found = evaluate(
                grid, placement, surrogates=["expected_ig"], detection_probability=q
            ).expected_ig
            assert shares[name] == pytest.approx(found / (q * float((rays * each).sum())), rel=1e-4)
            assert low <= shares[name] <= high


def test_a_stride_approximates_all_rays(grids):
    dense = PAPER_PLACEMENTS["line_roll"].with_lidar(Lidar(LIDAR.elevations, 3600))
    for occlusion in (False, True):
        exact, thinned = (
            evaluate(
                grids["Car"], dense, surrogates=NAMES, occlusion=occlusion, azimuth_stride=stride
            )
            for stride in (1, 4)
        )
        assert thinned.s_mig == exact.s_mig
        for name in NAMES:
            error = getattr(thinned, name) / getattr(exact, name) - 1
            assert 0 < abs(error) < 0.02


def test_a_sensor_that_looks_down_sees_its_column_only(grids):
    down = Placement("down", [Mount(0.7, 0.1, 1.9)], lidar=Lidar((-math.pi / 2,), 4))
    grid = grids["Car"]
    result = evaluate(grid, down)
    assert result.covered_voxels == 10
    assert result.covered_entropy == pytest.approx(math.fsum(grid.entropy[3, 15]), rel=1e-14)
