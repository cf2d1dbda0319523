"""Stiff and extreme cases: the right value by mpmath, rational numbers or counting, or an error."""

import math
import re
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.base.errors import InputError
from lidarplace.coverage import coverage
from lidarplace.coverage.rays import ray_counts
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.pog.surrogates.formulas import information
from tests.lidarplace.voxel_by_voxel import covered_voxel_by_voxel

ROI = Roi(x=(0.0, 1.5), y=(-0.75, 0.75), z=(0.0, 1.0), resolution=0.25)
DECIMAL = Roi(x=(0.0, 0.6), y=(-0.3, 0.3), z=(0.0, 0.4), resolution=0.1)
SMALL = Roi(x=(0.0, 0.6), y=(-0.3, 0.3), z=(0.0, 0.4), resolution=0.2)
ONE_VOXEL = Roi(x=(0.0, 1.0), y=(0.0, 1.0), z=(0.0, 1.0), resolution=1.0)
HALF_TURN, RIGHT_ANGLE = math.pi, math.pi / 2
MANY = 10**7
DIGITS = 50


def one_sensor(mount, elevations, steps=4, **limits):
    return Placement("one", [mount], lidar=Lidar(tuple(elevations), steps, **limits))


def x_log_x(x):
    return x * mpmath.log(x) if x else mpmath.mpf(0)


@cache
def exact_entropy(count, frames):
    """H of one voxel, DIGITS digits."""
    with mpmath.workdps(DIGITS):
        p = mpmath.mpf(count) / frames
        return -x_log_x(p) - x_log_x(1 - p)


def exact_entropy_sum(counts, frames):
    """Sum of H, voxel after voxel."""
    with mpmath.workdps(DIGITS):
        return mpmath.fsum(exact_entropy(int(count), frames) for count in counts.ravel())


def exact_information(p, rest, log_miss):
    """I of one voxel from entropies, for floats p and rest of which the smaller is trusted."""
    with mpmath.workdps(400):
        p, rest = mpmath.mpf(p), mpmath.mpf(rest)
        p, rest = (p, 1 - p) if p < rest else (1 - rest, rest)
        miss = mpmath.exp(log_miss)
        silent = rest + p * miss  # nothing is detected
        h_silent = -x_log_x(p * miss / silent) - x_log_x(rest / silent) if silent else 0
        return float(-x_log_x(p) - x_log_x(rest) - silent * h_silent)


def exact_axis(mount):
    """z axis of the sensor in the ego frame."""
    sin, cos = mpmath.sin, mpmath.cos
    roll, pitch, yaw = mount.roll, mount.pitch, mount.yaw
    return (
        cos(yaw) * sin(pitch) * cos(roll) + sin(yaw) * sin(roll),
        sin(yaw) * sin(pitch) * cos(roll) - cos(yaw) * sin(roll),
        cos(pitch) * cos(roll),
    )


def cube_meets_cone(low, high, n, s):
    """Whether a closed cube, relative to the sensor, holds a point d with n.d = s |d|.

    For s >= 0 the points with n.d >= s |d| are a convex cone. The cube meets its surface if some
    corner is outside or on it, and some point of the cube is inside or on it: a corner, a point of
    the axis, or a point where an edge crosses the surface.
    """
    if s < 0:
        n, s = [-c for c in n], -s
    if all(a <= 0 <= b for a, b in zip(low, high, strict=True)):
        return True
    corners = [
        (x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])
    ]
    sides = [mpmath.fdot(n, d) - s * mpmath.sqrt(mpmath.fdot(d, d)) for d in corners]
    if min(sides) > 0:
        return False
    return max(sides) >= 0 or _meets_axis(low, high, n) or _edge_meets_cone(low, high, n, s)


def _meets_axis(low, high, n):
    near, far = mpmath.mpf(0), mpmath.inf
    for a, b, d in zip(low, high, n, strict=True):
        if d == 0 and not a <= 0 <= b:
            return False
        if d != 0:
            near, far = max(near, min(a / d, b / d)), min(far, max(a / d, b / d))
    return near <= far


def _edge_meets_cone(low, high, n, s):
    for axis in range(3):
        other, third = (axis + 1) % 3, (axis + 2) % 3
        for p in (low[other], high[other]):
            for q in (low[third], high[third]):
                # (A + n w)^2 = s^2 (B + w^2) for the coordinate w along the edge
                along = n[other] * p + n[third] * q
                a, b = n[axis] ** 2 - s**2, along * n[axis]
                c = along**2 - s**2 * (p**2 + q**2)
                if a == 0:
                    roots = [-c / (2 * b)] if b else []
                elif b**2 < a * c:
                    roots = []
                else:
                    root = mpmath.sqrt(b**2 - a * c)
                    roots = [(-b + root) / a, (-b - root) / a]
                if any(low[axis] <= w <= high[axis] and along + n[axis] * w >= 0 for w in roots):
                    return True
    return False


def exactly_covered(roi, mount, elevations, voxel, grow=0.0):
    """Whether the cone of some beam meets a voxel that is grown by a share of its edge."""
    with mpmath.workdps(DIGITS):
        edge = mpmath.mpf(roi.resolution)
        low, high = [], []
        for axis, sensor in enumerate((mount.x, mount.y, mount.z)):
            start = mpmath.mpf(float(roi.minimum[axis])) - mpmath.mpf(sensor)
            low.append(start + (voxel[axis] - grow) * edge)
            high.append(start + (voxel[axis] + 1 + grow) * edge)
        n = exact_axis(mount)
        return any(cube_meets_cone(low, high, n, mpmath.sin(e)) for e in map(float, elevations))


def assert_covered_exactly(roi, mount, elevations, grow=2e-9, **limits):
    """Both algorithms cover what exact cubes cover, and no more than grown cubes do."""
    placement = one_sensor(mount, elevations, **limits)
    by_column, by_voxel = coverage(placement, roi), covered_voxel_by_voxel(placement, roi)
    for voxel in np.ndindex(roi.shape):
        if by_column[voxel] or by_voxel[voxel]:
            assert exactly_covered(roi, mount, elevations, voxel, grow), f"{voxel} is not covered"
        if not (by_column[voxel] and by_voxel[voxel]):
            assert not exactly_covered(roi, mount, elevations, voxel), f"{voxel} is covered"


ANGLES = [90.0, 89.999999, 1e-7, 0.0, -30.0, -45.0, -89.999999, -90.0]
POSES = {
    "inside a voxel": (0.33, 0.07, 0.21),
    "on a corner": (0.5, 0.0, 0.25),
    "on an edge": (0.5, 0.0, 0.3),
    "on a face": (0.5, 0.07, 0.3),
    "1e-9 m from a face": (0.5 + 1e-9, 0.07, 0.3),
    "outside": (-0.4, 0.9, 1.3),
    "under the ground": (0.4, 0.1, -0.3),
    "on the border": (0.0, 0.1, 1.0),
}


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("position", POSES.values(), ids=POSES)
def test_cones_of_an_upright_sensor(position, degrees):
    # Next to the axis sines tell directions apart by 3e-8 rad, 4e-8 m at the far end of this ROI.
    grow = 2e-7 if abs(degrees) > 89.9 else 2e-9
    assert_covered_exactly(ROI, Mount(*position), np.radians([degrees]), grow)


@pytest.mark.parametrize("degrees", [90.0, 0.0, -45.0, 20.0])
@pytest.mark.parametrize(
    "turn",
    [
        {"roll": 1e-9},
        {"pitch": -1e-9},
        {"roll": RIGHT_ANGLE},
        {"roll": -RIGHT_ANGLE, "yaw": 6.2},
        {"pitch": RIGHT_ANGLE},
        {"pitch": -RIGHT_ANGLE, "yaw": 0.3},
        {"roll": HALF_TURN},
        {"pitch": HALF_TURN},
        {"roll": RIGHT_ANGLE, "pitch": RIGHT_ANGLE},
    ],
    ids=str,
)
def test_cones_of_a_turned_sensor(turn, degrees):
    for position in (POSES["inside a voxel"], POSES["on a corner"]):
        assert_covered_exactly(ROI, Mount(*position, **turn), np.radians([degrees]))


@pytest.mark.parametrize("distance", [1e3, 1e5])
def test_a_sensor_far_away(distance):
    limits = {"range": math.inf}
    assert_covered_exactly(ROI, Mount(-distance, 0.1, 0.3), [0.0], **limits)
    assert_covered_exactly(ROI, Mount(-distance, 0.1, 0.3, pitch=0.3), [0.3], **limits)
    assert_covered_exactly(ROI, Mount(-distance, 0.1, 0.3, pitch=RIGHT_ANGLE), [1.5], **limits)
    assert_covered_exactly(ROI, Mount(0.2, 0.1, distance), [-RIGHT_ANGLE], **limits)
    assert_covered_exactly(ROI, Mount(0.2, 0.1, distance, roll=0.1), [0.1 - RIGHT_ANGLE], **limits)
    assert not coverage(one_sensor(Mount(-distance, 0.1, 0.3), [0.0], range=99.0), ROI).any()


@pytest.mark.parametrize("edge", [1e-3, 1e3])
@pytest.mark.parametrize("roll", [0.0, 0.3, RIGHT_ANGLE])
def test_tiny_and_huge_voxels(edge, roll):
    roi = Roi((0.0, 6 * edge), (-3 * edge, 3 * edge), (0.0, 4 * edge), edge)
    for position in ((3.3, 0.7, 2.1), (2.0, 0.0, 1.0)):
        mount = Mount(*(edge * c for c in position), roll=roll)
        assert_covered_exactly(roi, mount, [-0.4, 0.0], range=math.inf)


def test_an_roi_far_from_the_origin():
    """Where the numbers have few bits nothing is lost; 0.1 m at 1e6 m costs 1e-9 of an edge."""
    away = Roi(*((1e6 + low, 1e6 + high) for low, high in (ROI.x, ROI.y, ROI.z)), ROI.resolution)
    lidar = Lidar((-0.4, 0.0, 0.2), 90)
    for roll in (0.0, 0.3):
        near = Placement("near", [Mount(0.5, 0.125, 0.3125, roll=roll)], lidar=lidar)
        mount = Mount(1e6 + 0.5, 1e6 + 0.125, 1e6 + 0.3125, roll=roll)
        far = Placement("far", [mount], lidar=lidar)
        for method in ("cone", "dda", "bresenham"):
            np.testing.assert_array_equal(coverage(far, away, method), coverage(near, ROI, method))
    decimal = Roi((1e6, 1e6 + 0.6), (-0.3, 0.3), (0.0, 0.4), 0.1)
    assert_covered_exactly(decimal, Mount(1e6 + 0.33, 0.07, 0.21, roll=0.3), [-0.4, 0.0], 4e-9)


angle = st.floats(-HALF_TURN, HALF_TURN)
coordinate = st.floats(-2.0, 2.0)


@given(st.builds(Mount, *[coordinate] * 3, *[angle] * 3), st.floats(-1.55, 1.55))
@settings(max_examples=60)
def test_any_cone(mount, elevation):
    assert_covered_exactly(SMALL, mount, [elevation])


@pytest.mark.parametrize("reach", [1e-9, 0.125, 0.375, 0.375 - 1e-6, 0.375 + 1e-6, 1e300, math.inf])
def test_a_range_that_ends_at_a_face(reach):
    """A level beam sweeps a disc; squares touch it by their distance, in rational numbers."""
    mount = Mount(0.625, 0.125, 0.125)
    expected = np.zeros(ROI.shape, bool)
    edge, limit = Fraction(1, 4), Fraction(min(reach, 1e6)) ** 2
    for i, j in np.ndindex(ROI.shape[:2]):
        x, y = i * edge - Fraction(5, 8), j * edge - Fraction(7, 8)
        expected[i, j, 0] = max(x, -x - edge, 0) ** 2 + max(y, -y - edge, 0) ** 2 <= limit
    placement = one_sensor(mount, [0.0], range=reach)
    np.testing.assert_array_equal(coverage(placement, ROI), expected)
    np.testing.assert_array_equal(covered_voxel_by_voxel(placement, ROI), expected)
    # Rays end before a face at their range: voxels are half open.
    ahead = coverage(one_sensor(mount, [0.0], steps=1, range=reach), ROI, "dda")
    ends = [3, 3, 4, 4, 5, 6, 6]
    order = [1e-9, 0.125, 0.375 - 1e-6, 0.375, 0.375 + 1e-6, 1e300, math.inf]
    last = ends[order.index(reach)]
    assert np.argwhere(ahead).tolist() == [[i, 3, 0] for i in range(2, last)]


def test_a_field_of_view_of_a_microradian_and_of_nearly_a_turn():
    mount = Mount(0.625, 0.125, 0.125)
    ray = np.zeros(ROI.shape, bool)
    ray[2:, 3, 0] = True
    narrow = {"azimuth": (-5e-7, 5e-7)}
    for method in ("cone", "dda", "bresenham"):
        found = coverage(one_sensor(mount, [0.0], **narrow), ROI, method)
        np.testing.assert_array_equal(found, ray)
    turned = coverage(one_sensor(Mount(0.625, 0.125, 0.125, yaw=RIGHT_ANGLE), [0.0], **narrow), ROI)
    assert np.argwhere(turned).tolist() == [[2, 3, 0], [2, 4, 0], [2, 5, 0]]
    # No voxel is hidden by a gap of 1e-9 rad that is not on its border.
    elevations, mount = (-0.4, 0.0, 0.3), Mount(0.6, 0.1, 0.4, roll=0.2)
    nearly = one_sensor(mount, elevations, azimuth=(0.1, 0.1 + 2 * HALF_TURN - 1e-9))
    np.testing.assert_array_equal(
        coverage(nearly, ROI), coverage(one_sensor(mount, elevations), ROI)
    )


@pytest.fixture(scope="module")
def wide_range():
    """Entropies from 1.7e-6 to 0.69; those of the column under a sensor are tiny."""
    rng = np.random.default_rng(0)
    counts = rng.integers(0, MANY, DECIMAL.shape).astype(np.int32)
    counts[rng.random(DECIMAL.shape) < 0.3] = 0
    counts[3, 3] = [1, 2, MANY - 1, MANY]
    return OccupancyGrid(DECIMAL, "Car", counts, MANY)


@pytest.mark.parametrize(
    "placement",
    [
        one_sensor(Mount(0.35, 0.05, 9.0), [-RIGHT_ANGLE]),
        one_sensor(Mount(0.33, 0.07, 0.21), [-0.4]),
        one_sensor(Mount(0.33, 0.07, 0.21), np.linspace(-1.5, 1.5, 40)),
    ],
    ids=["few tiny", "some", "all"],
)
def test_sums_against_mpmath(wide_range, placement):
    result = evaluate(wide_range, placement)
    covered = coverage(placement, DECIMAL)
    total = exact_entropy_sum(wide_range.counts, MANY)
    seen = exact_entropy_sum(wide_range.counts[covered], MANY)
    unseen = exact_entropy_sum(wide_range.counts[~covered], MANY)
    assert seen > 0
    assert abs(result.h_pog - total) <= 1e-15 * total
    assert abs(-result.s_mig - seen) <= 1e-15 * seen
    for difference in (result.ig, result.residual_entropy):
        assert abs(difference - unseen) <= 1e-15 * unseen


@pytest.mark.parametrize("count", [0, 1])
def test_a_single_frame_has_no_entropy(count):
    grid = OccupancyGrid(ROI, "Car", np.full(ROI.shape, count, np.int32), 1)
    asked = ["expected_points", "expected_ig"]
    result = evaluate(grid, one_sensor(Mount(0.3, 0.1, 0.2), [0.0]), surrogates=asked)
    assert (result.h_pog, result.s_mig, result.ig, result.m_sog) == (0.0, 0.0, 0.0, 0.0)
    assert (result.expected_points > 0, result.expected_ig) == (count == 1, 0.0)


def test_expected_points_are_exact(wide_range):
    placement = one_sensor(Mount(0.3, 0.0, 0.2), np.radians(np.linspace(-25, 15, 128)), steps=500)
    found = evaluate(wide_range, placement, surrogates=["expected_points"]).expected_points
    rays = ray_counts(placement, DECIMAL, "dda").ravel().tolist()
    counts = wide_range.counts.ravel().tolist()
    meetings = sum(m * count for m, count in zip(rays, counts, strict=True))
    assert found == float(Fraction(meetings, MANY))


@pytest.mark.parametrize("log_miss", [-1e-300, -1e-12, -1e-3, -2e-3, -0.1, -5.0, -800.0, -math.inf])
@pytest.mark.parametrize("small", [1e-300, 1e-100, 1e-16, 1e-7, 1e-3, 0.4999, 0.5])
def test_information_at_both_ends_of_p(small, log_miss):
    for p, rest in ((small, 1 - small), (1 - small, small)):
        found = information(np.array([p]), np.array([rest]), np.array([log_miss]))[0]
        # Below 1e-300 floats lose their digits.
        assert found == pytest.approx(exact_information(p, rest, log_miss), rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("rays", "q"), [(1, 1e-12), (1, 0.1), (1, 1.0), (1000, 1e-3), (10**6, 1e-12), (10**6, 1e-6)]
)
@pytest.mark.parametrize("count", [1, MANY // 2, MANY - 1, MANY])
def test_expected_ig_of_one_voxel(count, rays, q):
    grid = OccupancyGrid(ONE_VOXEL, "Car", np.full((1, 1, 1), count, np.int32), MANY)
    placement = one_sensor(Mount(0.5, 0.5, 0.5), [0.1], steps=rays)
    found = evaluate(grid, placement, surrogates=["expected_ig"], detection_probability=q)
    expected = exact_expected_ig(count, rays, q)
    assert found.expected_ig == pytest.approx(expected, rel=1e-12, abs=1e-300)


def exact_expected_ig(count, rays, q):
    """I of a voxel that is occupied in `count` of MANY frames."""
    with mpmath.workdps(DIGITS):
        p, rest = mpmath.mpf(count) / MANY, mpmath.mpf(MANY - count) / MANY
        log_miss = rays * mpmath.log(1 - mpmath.mpf(q)) if q < 1 else -mpmath.inf
        return exact_information(p, rest, log_miss) if rays else 0.0


def boxes_of(*rows):
    """rows: (x, y, z, length, width, height, yaw), a frame each."""
    boxes = pd.DataFrame(rows, columns=list(GEOMETRY), dtype=np.float64)
    return boxes.assign(frame=np.arange(len(rows)), **{"class": "Car"})


def test_a_yaw_of_1e9_and_more():
    """The angle is reduced exactly, as mpmath does."""
    for yaw in (1e9, -1e9, 1e15):
        box = (0.7, 0.05, 0.5, 1.3, 0.35, 0.5, yaw)
        grid = OccupancyGrid.from_boxes(boxes_of(box), ROI, "Car", frames=1)
        with mpmath.workdps(DIGITS):
            cos, sin = mpmath.cos(yaw), mpmath.sin(yaw)
            for voxel, count in np.ndenumerate(grid.counts):
                x, y, z = (float(ROI.centres(a)[voxel[a]]) - mpmath.mpf(box[a]) for a in range(3))
                inside = abs(z) <= 0.25 and abs(cos * x + sin * y) <= mpmath.mpf(box[3]) / 2
                assert count == (inside and abs(cos * y - sin * x) <= mpmath.mpf(box[4]) / 2)
        assert 4 < grid.counts.sum() < ROI.shape[0] * ROI.shape[1] * 2


def test_boxes_of_zero_size_and_of_a_kilometre():
    rows = {
        "a point on a centre": ((0.625, 0.125, 0.375, 0, 0, 0, 0.0), 1),
        "a point beside a centre": ((0.625, 0.125, 0.375 + 1e-9, 0, 0, 0, 0.0), 0),
        "a segment through centres": ((0.625, 0.125, 0.375, 9, 0, 0, 0.0), 6),
        "a sheet through centres": ((0.625, 0.125, 0.375, 9, 9, 0, 0.3), 36),
        "a kilometre": ((0.0, 0.0, 0.0, 1e3, 1e3, 1e3, 1e9), 144),
        "far away": ((1e9, 0.0, 0.0, 1e3, 1e3, 1e3, 0.0), 0),
    }
    for name, (row, expected) in rows.items():
        grid = OccupancyGrid.from_boxes(boxes_of(row), ROI, "Car", frames=1)
        assert grid.counts.sum() == expected, name


def test_an_roi_of_one_voxel():
    box = (0.5, 0.5, 0.5, 0.1, 0.1, 0.1, 0.0)
    grid = OccupancyGrid.from_boxes(boxes_of(box), ONE_VOXEL, "Car", frames=4)
    p = Fraction(1, 4)
    for method in ("cone", "dda", "bresenham"):
        placement = one_sensor(Mount(0.5, 0.5, 0.5), [0.1], steps=3)
        result = evaluate(grid, placement, method, surrogates=["expected_points"])
        assert result.s_mig == pytest.approx(-float(exact_entropy(1, 4)), rel=1e-15)
        assert (result.ig, result.covered_voxels) == (0.0, 1)
        assert result.expected_points == float(3 * p)


@pytest.mark.parametrize("length", [1.03, 0.96, 0.04, 12.34567])
def test_the_resolution_suggested_fits(length):
    with pytest.raises(InputError) as error:
        Roi((0.0, length), (0.0, 1.0), (0.0, 1.0), 0.1)
    nearest = float(re.findall(r"nearest resolution (\S+) m", error.value.fix)[0])
    roi = Roi(*[(0.0, length)] * 3, nearest)
    cells = roi.shape[0]
    others = [length / n for n in (cells - 1, cells + 1) if n]
    assert all(abs(nearest - 0.1) <= abs(other - 0.1) for other in others)
