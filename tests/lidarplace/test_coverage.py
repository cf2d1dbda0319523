import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.coverage import coverage
from lidarplace.coverage.bresenham import bresenham_voxels
from lidarplace.coverage.cone import covered_by_cones, covered_voxel_by_voxel
from lidarplace.coverage.rays import log_miss, ray_counts

ROI = Roi(x=(0.0, 3.0), y=(-1.5, 1.5), z=(0.0, 2.0), resolution=0.25)
LIDAR = Lidar(tuple(np.radians([-60.0, -25.0, -3.0, 0.0, 5.0, 40.0])), azimuth_steps=720)

right_angle = math.pi / 2
angle = st.one_of(st.floats(-right_angle, right_angle), st.sampled_from([0.0, right_angle]))
mounts = st.builds(
    Mount,
    # Positions on voxel corners and faces, inside and outside the ROI, and anywhere.
    x=st.one_of(st.floats(-4, 6), st.sampled_from([0.0, 0.5, 1.25])),
    y=st.one_of(st.floats(-4, 4), st.sampled_from([-1.5, 0.0, 0.25])),
    z=st.one_of(st.floats(-3, 6), st.sampled_from([0.0, 1.0, 2.0])),
    roll=angle,
    pitch=angle,
    yaw=st.floats(-math.pi, math.pi),
)


@given(mounts)
@example(Mount(0.5, 0.25, 1.0))
@example(Mount(0.5, 0.25, 1.0, roll=right_angle))
@example(Mount(1.0, 0.0, 5.0, pitch=right_angle))
@settings(max_examples=150, deadline=None)
def test_columns_and_voxels_agree(mount):
    placement = Placement("one", [mount], lidar=LIDAR)
    np.testing.assert_array_equal(
        covered_by_cones(placement, ROI), covered_voxel_by_voxel(placement, ROI)
    )


@given(mounts)
@settings(max_examples=60, deadline=None)
def test_traversed_voxels_are_covered_by_the_cones(mount):
    placement = Placement("one", [mount], lidar=LIDAR)
    traversed = coverage(placement, ROI, "dda")
    assert not (traversed & ~coverage(placement, ROI, "cone")).any()


@given(mounts)
@settings(max_examples=40, deadline=None)
def test_voxels_without_cone_have_no_point_of_it(mount):
    """Independent of both algorithms: points of the cones fall into covered voxels only."""
    placement = Placement("one", [mount], lidar=LIDAR)
    covered = coverage(placement, ROI, "cone")
    directions = LIDAR.directions() @ mount.rotation.T
    points = mount.position + directions[:, None, :] * np.linspace(0.01, 8, 200)[:, None]
    cells = (points.reshape(-1, 3) - ROI.minimum) / ROI.resolution
    cells = cells[((cells >= 0) & (cells < ROI.shape)).all(axis=1)].astype(int)
    assert covered[tuple(cells.T)].all()


def test_traversal_converges_to_the_cones():
    placement = PAPER_PLACEMENTS["line_roll"]
    exact = np.count_nonzero(coverage(placement, ROI, "cone"))
    missing = []
    for steps in (90, 360, 1440, 5760, 92160):
        lidar = Lidar(placement.lidar.elevations, azimuth_steps=steps)
        found = np.count_nonzero(coverage(placement.with_lidar(lidar), ROI, "dda"))
        missing.append(exact - found)
    assert missing == sorted(missing, reverse=True)
    assert 0 <= missing[-1] <= 0.002 * exact
    assert missing[0] > 0.02 * exact


def test_vertical_beams_and_beams_along_voxel_planes():
    down = Placement("down", [Mount(0.6, 0.1, 1.9)], lidar=Lidar((-right_angle,), 4))
    covered = coverage(down, ROI, "cone")
    expected = np.zeros(ROI.shape, bool)
    expected[2, 6, :8] = True
    np.testing.assert_array_equal(covered, expected)
    # A horizontal beam in the plane between two layers touches both.
    level = Placement("level", [Mount(0.6, 0.1, 1.0)], lidar=Lidar((0.0,), 4))
    layers = coverage(level, ROI, "cone").all(axis=(0, 1))
    assert list(np.flatnonzero(layers)) == [3, 4]


def test_a_beam_that_misses_the_roi_covers_nothing():
    up = Placement("up", [Mount(0.0, 0.0, 3.0)], lidar=Lidar((0.3, 0.6), 360))
    for method in ("cone", "dda", "bresenham"):
        assert not coverage(up, ROI, method).any()


def test_one_voxel():
    roi = Roi(x=(0, 1), y=(0, 1), z=(0, 1), resolution=1.0)
    inside = Placement("inside", [Mount(0.5, 0.5, 0.5)], lidar=Lidar((0.1,), 8))
    for method in ("cone", "dda", "bresenham"):
        assert coverage(inside, roi, method).all()


def test_range_limits_rays_and_is_refused_by_the_cones():
    lidar = Lidar((-0.1,), 360, range=1.0)
    placement = Placement("short", [Mount(0.0, 0.0, 1.0)], lidar=lidar)
    covered = coverage(placement, ROI, "dda")
    reached = ROI.centres(0)[covered.any(axis=(1, 2))]
    assert reached.max() < 1.25
    with pytest.raises(ValueError, match="found 1 m; method 'dda' takes a shorter range"):
        coverage(placement, ROI, "cone")


def test_unknown_method():
    with pytest.raises(ValueError, match="one of cone, dda, bresenham"):
        coverage(PAPER_PLACEMENTS["line"], ROI, "rays")


def textbook_line(start, end):
    """Bresenham's line in 3D by rounding the exact rational point of every step, ties down."""
    delta = [b - a for a, b in zip(start, end, strict=True)]
    steps = max(map(abs, delta))
    for n in range(steps + 1):
        yield tuple(
            a + (1 if d > 0 else -1) * -((steps - 2 * n * abs(d)) // (2 * steps)) if steps else a
            for a, d in zip(start, delta, strict=True)
        )


@given(
    st.tuples(st.floats(0.01, 2.99), st.floats(-1.49, 1.49), st.floats(0.01, 1.99)),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
)
@settings(max_examples=200, deadline=None)
def test_bresenham_is_the_textbooks(origin, direction):
    origin, direction = np.array(origin), np.array(direction)
    length = np.linalg.norm(direction)
    if length < 1e-3:
        return
    direction /= length
    voxels, _ = bresenham_voxels(
        origin, direction[None], 100.0, ROI.minimum, ROI.resolution, *ROI.shape
    )
    cells = [tuple(int(c) for c in np.unravel_index(v, ROI.shape)) for v in voxels]
    start = tuple(np.floor((origin - ROI.minimum) / ROI.resolution).astype(int).tolist())
    assert cells[0] == start
    assert cells == list(textbook_line(start, cells[-1]))
    # The last voxel is where the ray leaves the grid: it touches the outer layer.
    assert any(c in (0, n - 1) for c, n in zip(cells[-1], ROI.shape, strict=True))


def test_ray_counts_are_the_sum_over_rays():
    placement = PAPER_PLACEMENTS["square"].with_lidar(LIDAR)
    counts = ray_counts(placement, ROI, "dda")
    np.testing.assert_array_equal(counts > 0, coverage(placement, ROI, "dda"))
    single = [ray_counts(Placement("m", [m], lidar=LIDAR), ROI, "dda") for m in placement.mounts]
    np.testing.assert_array_equal(counts, sum(single))


def test_an_occupied_voxel_stops_rays_that_are_weighed_by_occlusion():
    placement = Placement("one", [Mount(-0.5, 0.1, 1.1)], lidar=Lidar((0.0,), 4))
    probability = np.zeros(ROI.shape)
    free = log_miss(placement, ROI, "dda", probability, 0.1)
    np.testing.assert_allclose(free[:, 6, 4], math.log1p(-0.1))
    probability[5, 6, 4] = 1.0
    hidden = log_miss(placement, ROI, "dda", probability, 0.1)
    np.testing.assert_allclose(hidden[:6, 6, 4], math.log1p(-0.1))
    np.testing.assert_array_equal(hidden[6:, 6, 4], 0.0)
