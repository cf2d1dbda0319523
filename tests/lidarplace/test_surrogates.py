"""Surrogates: a golden log, many placements, classes and q at once, and what the table says."""

import inspect
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mypy import api

from lidarplace import (
    PAPER_PLACEMENTS,
    Lidar,
    Mount,
    OccupancyGrid,
    Placement,
    Roi,
    evaluate,
    evaluate_classes,
    evaluate_many,
    expected_ig_of_rays,
    sum_over_classes,
)
from lidarplace.base import plotting
from lidarplace.coverage import count_covered
from lidarplace.coverage.rays import ray_counts
from lidarplace.pog.surrogates import result as result_module
from lidarplace.pog.surrogates.evaluate import linear_share
from lidarplace.pog.surrogates.table import POG_SURROGATES, SURROGATES
from tests.lidarplace.random_grids import random_grids

ROI = Roi(x=(0.0, 6.0), y=(-3.0, 3.0), z=(0.0, 2.0), resolution=0.2)
LIDAR = Lidar(tuple(np.radians([-40.0, -20.0, -3.0, 5.0])), azimuth_steps=360)
NAMES = ("expected_points", "expected_ig")
DATA = Path(__file__).parents[1] / "data/smig"
GOLDEN = json.loads((DATA / "golden.json").read_text())


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
    for name in ("s_mig", "ig", "h_pog", "covered_entropy", "residual_entropy", *NAMES):
        expected = math.fsum(getattr(r, name) for r in results.values())
        assert getattr(total, name) == pytest.approx(expected, rel=1e-14)
    assert total.covered_voxels == results["Car"].covered_voxels
    assert total.m_sog == total.s_mig / total.covered_voxels
    assert sum_over_classes(evaluate_classes(grids, placement)).expected_ig is None
    other = evaluate(grids["Pedestrian"], PAPER_PLACEMENTS["line"])
    with pytest.raises(ValueError, match="one placement, ROI and method"):
        sum_over_classes({"Car": results["Car"], "Pedestrian": other})


@pytest.mark.parametrize("q", [1e-9, 0.003, 0.1, 1.0])
def test_expected_ig_of_rays_needs_no_cones(grids, q):
    placement = PAPER_PLACEMENTS["pyramid"].with_lidar(LIDAR)
    gains = expected_ig_of_rays(grids, placement, q)
    results = evaluate_classes(
        grids, placement, "dda", surrogates=["expected_ig"], detection_probability=q
    )
    assert gains.to_dict() == {name: result.expected_ig for name, result in results.items()}


def test_linear_share_is_that_of_rays_that_count_by_themselves(grids):
    """By the formula, ray by ray; near 1 for few faint rays, near 0 where many rays see all."""
    for steps, q, low, high in (
        (12, 1e-3, 0.99, 1.001),
        (360, 0.1, 0.1, 0.9),
        (7200, 0.9, 0.0, 0.1),
    ):
        placement = PAPER_PLACEMENTS["line"].with_lidar(Lidar(LIDAR.elevations, steps))
        shares = linear_share(grids, placement, q)
        rays = ray_counts(placement, ROI, "dda")
        for name, grid in grids.items():
            p = grid.probability
            each = np.where(p > 0, -p * np.log(np.where(p > 0, p, 1)), 0)  # I / q as q goes to 0
            found = evaluate(
                grid, placement, surrogates=["expected_ig"], detection_probability=q
            ).expected_ig
            assert shares[name] == pytest.approx(found / (q * float((rays * each).sum())), rel=1e-4)
            assert low <= shares[name] <= high


@pytest.fixture(scope="module")
def golden_grids():
    boxes = pd.read_csv(DATA / "boxes.csv")
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=GOLDEN["resolution"])
    return OccupancyGrid.by_class(boxes, roi, list(GOLDEN["classes"]), GOLDEN["frames"])


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


def test_azimuth_steps_override_the_lidars_own(grids):
    rig = PAPER_PLACEMENTS["line_roll"].with_lidar(LIDAR)
    few, many = (evaluate(grids["Car"], rig, "dda", azimuth_steps=n) for n in (8, 800))
    assert few.covered_voxels < many.covered_voxels
    by_cones = [evaluate(grids["Car"], rig, azimuth_steps=n).s_mig for n in (8, None)]
    assert by_cones[0] == by_cones[1]


def test_a_placement_that_sees_nothing(grids):
    up = Placement("up", [Mount(z=3.0)], lidar=Lidar((0.5,), 90))
    result = evaluate(grids["Car"], up, surrogates=NAMES)
    assert result.s_mig == result.expected_points == result.expected_ig == 0.0
    assert math.isnan(result.m_sog)


@pytest.mark.parametrize("occlusion", [False, True])
@pytest.mark.parametrize("name", POG_SURROGATES)
def test_more_lidars_do_what_its_sense_says(grids, name, occlusion):
    own = SURROGATES[name]
    mounts = [Mount(y=y, z=2.2, roll=roll) for y, roll in ((-0.6, 0.2), (0.6, -0.2), (0.0, 0.0))]
    rigs = [Placement("rig", mounts[:n], LIDAR) for n in (1, 2, 3)]
    asked = [name] if own.needs_rays else []
    results = [evaluate(grids["Car"], rig, surrogates=asked, occlusion=occlusion) for rig in rigs]
    values = np.array([getattr(result, name) for result in results])
    assert not own.fixed or len(set(values)) == 1
    assert np.all(np.diff(values) * own.sense > 0) or own.sense == 0
    assert (getattr(evaluate(grids["Car"], rigs[0]), name) is None) == own.needs_rays


def test_no_other_name_is_an_attribute(grids):
    result = evaluate(grids["Car"], PAPER_PLACEMENTS["line"].with_lidar(LIDAR))
    assert {*POG_SURROGATES} < {*dir(result)}
    with pytest.raises(AttributeError, match="no attribute 's_nig'"):
        result.s_nig  # noqa: B018 - reading it raises


def test_a_misspelt_surrogate_is_a_mistake_to_mypy(tmp_path):
    code = "from lidarplace.pog.surrogates.result import Surrogates as S\n\n\n"
    code += "def add(one: S) -> float:\n    return one.s_mig + one.covered_voxels + one.s_migg\n"
    (tmp_path / "reads.py").write_text(code)
    files = [inspect.getfile(plotting), inspect.getfile(result_module), str(tmp_path / "reads.py")]
    quick = ["--config-file=", "--follow-imports=skip", "--cache-dir", str(tmp_path)]
    found, _, _ = api.run([*quick, *files])
    assert [line for line in found.splitlines() if " error: " in line and "s_migg" in line], found
    assert found.count(" error: ") == 1, found
