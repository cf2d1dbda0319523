import numpy as np
import pytest

from lidarplace import (
    PAPER_PLACEMENTS,
    Lidar,
    Mount,
    OccupancyGrid,
    Placement,
    Roi,
    evaluate_classes,
)
from lidarplace.pog.selection import Exposure, Limits
from lidarplace.pog.surrogates.inputs import Sensing
from tests.lidarplace.random_grids import random_grids
from tests.lidarplace.selection.small_exposures import greedy, upper_bound

ROI = Roi(x=(0.0, 6.0), y=(-3.0, 3.0), z=(0.0, 2.0), resolution=0.2)
LIDAR = Lidar(tuple(np.radians([-40.0, -20.0, -3.0, 5.0])), azimuth_steps=360)
FEWER = Lidar(tuple(np.radians([-15.0, 0.0])), azimuth_steps=360)
WEIGHTS = {"Car": 1.0, "Pedestrian": 2.5}
MOUNTS = PAPER_PLACEMENTS["line_roll"].mounts
CANDIDATES = [
    Placement("left", [MOUNTS[0]], lidar=LIDAR),
    Placement("right", [MOUNTS[3]], lidar=LIDAR),
    Placement("pair", MOUNTS[1:3], lidar=LIDAR),
    Placement("mixed", [Mount(x=1.0, z=1.0), Mount(x=1.0, z=1.2, pitch=0.2)], lidar=[LIDAR, FEWER]),
    Placement("behind", [Mount(x=-50.0, z=-5.0, pitch=-1.2)], lidar=LIDAR),
]
SETS = ([], [0], [2], [0, 1], [0, 1, 2, 3], [3, 4], [4])


@pytest.fixture(scope="module")
def grids():
    grids = random_grids(ROI)
    for grid in grids.values():
        grid.counts[:, :, 7:] = 0
        grid.counts[5, 5, 3] = 100  # p = 1
    return grids


def reference(grids, chosen, surrogate, weights=WEIGHTS, **options):
    if not chosen:
        return 0.0
    parts = [CANDIDATES[e] for e in chosen]
    mounts = [mount for part in parts for mount in part.mounts]
    union = Placement("union", mounts, [lidar for part in parts for lidar in part.lidars])
    asked = [] if surrogate == "covered_entropy" else [surrogate]
    results = evaluate_classes(grids, union, surrogates=asked, **options)
    return sum(weights[name] * getattr(results[name], surrogate) for name in weights)


@pytest.mark.parametrize(
    ("surrogate", "options"),
    [
        ("covered_entropy", {}),
        ("covered_entropy", {"method": "dda"}),
        ("expected_ig", {}),
        ("expected_ig", {"azimuth_stride": 4, "detection_probability": 0.01}),
        ("expected_ig", {"azimuth_stride": 4, "detection_probability": 1.0}),
        ("expected_ig", {"detection_probability": 1e-7}),  # no table of gains: it would be long
        ("expected_ig", {"occlusion": True, "azimuth_stride": 2}),
        ("expected_ig", {"occlusion": True, "detection_probability": 1.0}),
        ("expected_ig", {"method": "bresenham"}),
        ("expected_points", {"azimuth_stride": 4}),
    ],
)
def test_the_value_of_a_set_is_the_surrogate_of_its_union(grids, surrogate, options):
    exposure = Exposure.of_candidates(grids, WEIGHTS, CANDIDATES, surrogate, Sensing(**options))
    for chosen in SETS:
        expected = reference(grids, chosen, surrogate, **options)
        assert exposure.value(chosen) == pytest.approx(expected, rel=1e-12, abs=1e-300)
    limits = Limits.at_most(3, len(CANDIDATES))
    found = greedy(exposure, limits)
    assert found.value == pytest.approx(exposure.value(found.chosen), rel=1e-12)
    assert upper_bound(exposure, limits, found.chosen, seconds=1).value >= found.value


def test_classes_without_weight_do_not_count(grids):
    for weights in ({"Car": 1.0}, {"Car": 1.0, "Pedestrian": 0.0}):
        exposure = Exposure.of_candidates(grids, weights, CANDIDATES, "covered_entropy")
        expected = reference(grids, [0, 2], "covered_entropy", {"Car": 1.0})
        assert exposure.value([0, 2]) == pytest.approx(expected, rel=1e-12)
        assert len(exposure.gain.profile) == (grids["Car"].counts > 0).sum()


@pytest.mark.parametrize("weights", [{}, {"Car": 0.0}])
def test_no_weight_at_all(grids, weights):
    exposure = Exposure.of_candidates(grids, weights, CANDIDATES)
    assert exposure.value([0, 1]) == 0
    limits = Limits.at_most(2, len(CANDIDATES))
    assert greedy(exposure, limits).chosen == ()
    assert upper_bound(exposure, limits).value == pytest.approx(0, abs=1e-7)


def test_an_empty_class_and_no_candidates(grids):
    empty = {"Car": OccupancyGrid(ROI, "Car", np.zeros(ROI.shape, np.int32), 100)}
    assert Exposure.of_candidates(empty, {"Car": 1.0}, CANDIDATES).value([0, 1]) == 0
    none = Exposure.of_candidates(grids, WEIGHTS, [])
    assert none.value([]) == 0
    assert greedy(none, Limits.at_most(2, 0)).chosen == ()


def test_covered_voxels_need_no_amounts(grids):
    exposure = Exposure.of_candidates(grids, WEIGHTS, CANDIDATES, "covered_entropy")
    assert exposure.amounts.strides == (0,)
    assert exposure.voxels.dtype == np.uint32
