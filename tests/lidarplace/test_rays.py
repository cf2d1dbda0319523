"""Walks along single rays against exact rational arithmetic, and what is made of them."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.coverage import rays
from lidarplace.coverage.rays import (
    VoxelGrid,
    VoxelLists,
    clip_rays,
    covered_by_rays,
    log_miss,
    ray_counts,
    ray_weight,
    thinned,
    walk_rays,
)
from tests.refused import refused


def voxels_of_rays(method, origin, directions, reach, grid):
    """Flat C-order indices and offsets: ray r has `voxels[offsets[r]:offsets[r + 1]]`.

    grid: minimum, resolution and shape.
    """
    minimum, resolution, shape = grid
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    voxel_grid = VoxelGrid(minimum.astype(np.float64), resolution, np.array(shape), strides)
    spans = clip_rays(origin, directions, reach, voxel_grid)
    voxels = np.empty(len(directions) * sum(shape), np.uint32)
    offsets = np.zeros(len(directions) + 1, np.int64)
    bresenham = method == "bresenham"
    lists = VoxelLists(voxels, offsets)
    walk_rays(bresenham, origin, directions, spans, reach, voxel_grid, lists)
    return voxels[: offsets[-1]], offsets


ROI = Roi(x=(0.0, 3.0), y=(-1.5, 1.5), z=(0.0, 2.0), resolution=0.25)
GRID = (ROI.minimum, ROI.resolution, ROI.shape)
LIDAR = Lidar(tuple(np.radians([-60.0, -25.0, -3.0, 0.0, 5.0, 40.0])), azimuth_steps=720)
RIG = PAPER_PLACEMENTS["line_roll"].with_lidar(LIDAR)

# A grid, origins and directions of few bits: every crossing is exact up to one division.
SHAPE, CORNER, EDGE = (4, 3, 3), (0.0, -1.0, 0.5), 0.5
dyadic = st.integers(-6, 16).map(lambda n: n / 4)
origins = st.tuples(dyadic, dyadic, dyadic)
component = st.integers(-12, 12).map(lambda n: n / 8)
directions = st.tuples(component, component, component).filter(any)
reaches = st.one_of(st.just(math.inf), st.integers(1, 40).map(lambda n: n / 8))


def walk(method, origin, direction, reach, grid=(CORNER, EDGE, SHAPE)):
    """Cells of one ray as tuples."""
    minimum, edge, shape = grid
    grid = (np.array(minimum), edge, shape)
    found, offsets = voxels_of_rays(method, np.array(origin), np.array([direction]), reach, grid)
    assert offsets.tolist() == [0, len(found)]
    cells = np.unravel_index(found.astype(np.int64), shape)
    return list(zip(*(axis.tolist() for axis in cells), strict=True))


def half_open_cubes_on_the_ray(origin, direction, reach):
    """Cells with a point of the open ray 0 < t < reach, in its order; rational numbers only.

    The parameters of a cell are an interval. Its ends are pairs that sort a closed lower end
    before an open one at the same t, and a closed upper end after an open one.
    """
    passed = []
    for cell in itertools.product(*map(range, SHAPE)):
        lower, upper = (Fraction(0), 1), (Fraction(reach) if reach < math.inf else 10**9, 0)
        for axis in range(3):
            o, d = Fraction(origin[axis]), Fraction(direction[axis])
            low = Fraction(CORNER[axis]) + cell[axis] * Fraction(EDGE)
            high = low + Fraction(EDGE)
            if d > 0:
                lower, upper = max(lower, ((low - o) / d, 0)), min(upper, ((high - o) / d, 0))
            elif d < 0:
                lower, upper = max(lower, ((high - o) / d, 1)), min(upper, ((low - o) / d, 1))
            elif not low <= o < high:
                lower = (Fraction(10**10), 1)
        if lower[0] < upper[0] or (lower[0] == upper[0] and (lower[1], upper[1]) == (0, 1)):
            passed.append((lower, cell))
    return [cell for _, cell in sorted(passed)]


@given(origins, directions, reaches)
@example((0.0, -1.0, 0.5), (1.0, 1.0, 1.0), math.inf)  # from a corner through all corners
@example((2.0, 0.5, 2.0), (-1.0, -1.0, -1.0), math.inf)
@example((0.0, 0.5, 1.0), (1.0, -1.0, 0.0), math.inf)  # along a plane, through edges
@example((-0.5, 0.0, 1.0), (1.0, 0.0, 0.0), math.inf)  # along an edge, from outside
@example((0.5, 0.0, 0.75), (0.0, -1.0, 0.0), math.inf)  # on a face, away from it
@example((1.0, 0.0, -0.75), (0.0, 0.0, 1.0), 1.25)  # from under the ground, up to a face
@example((-0.5, 0.0, 0.5), (1.0, -1.0, -1.0), math.inf)  # touches the grid at an edge
@settings(max_examples=250)
def test_dda_lists_the_half_open_cubes_with_a_point_of_the_ray(origin, direction, reach):
    assert walk("dda", origin, direction, reach) == half_open_cubes_on_the_ray(
        origin, direction, reach
    )


coordinate = st.floats(-4, 6)
unit = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda d: np.linalg.norm(d) > 1e-3
)


def chords(o, d, reach, grow):
    """Length of the ray in every cube of ROI, grown on all sides; negative where it misses."""
    low = np.stack(np.indices(ROI.shape), axis=-1) * ROI.resolution + ROI.minimum - o - grow
    high = low + ROI.resolution + 2 * grow
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        faces = np.stack([low / d, high / d])
    within = (low <= 0) & (high >= 0)
    enter = np.where(d == 0, np.where(within, -np.inf, np.inf), faces.min(axis=0)).max(axis=-1)
    leave = np.where(d == 0, np.where(within, np.inf, -np.inf), faces.max(axis=0)).min(axis=-1)
    return np.minimum(leave, reach) - np.maximum(enter, 0.0)


@given(st.tuples(coordinate, coordinate, coordinate), unit, st.floats(0.1, 20))
@settings(max_examples=100)
def test_dda_along_any_ray(origin, direction, reach):
    """Cubes shrunk by a hair that the ray meets are listed, and only cubes grown by a hair."""
    o, d = np.array(origin), np.array(direction) / np.linalg.norm(direction)
    cells = walk("dda", o, d, reach, GRID)
    listed = np.zeros(ROI.shape, bool)
    listed[tuple(np.array(cells, int).reshape(-1, 3).T)] = True
    assert len(cells) == np.count_nonzero(listed)
    assert listed[chords(o, d, reach, -1e-9) > 1e-9].all()
    assert (chords(o, d, reach, 1e-9)[listed] >= 0).all()
    # In order: every step goes along the ray, to a neighbour.
    steps = np.diff(np.array(cells, int).reshape(-1, 3), axis=0)
    assert (steps * np.sign(d) >= 0).all()
    assert (np.abs(steps).max(axis=1) == 1).all()


def test_errors_do_not_grow_along_the_ray():
    """10,000 voxels of an edge that has no exact binary form, against rational numbers."""
    n, edge, slope = 10**4, 0.1, Fraction(1, 3)
    flat = walk("dda", (0.05, 0.05, 1e-12), (1.0, 0, 0), 1e9, ((0, 0, 0), edge, (n, 1, 1)))
    assert flat == [(i, 0, 0) for i in range(n)]
    ray = np.array([3.0, 1.0, 0.0]) / math.sqrt(10)
    cells = walk("dda", (0.05, 0.06, 0.05), ray, 1e9, ((0, 0, 0), edge, (n, n, 1)))
    # At the middle of every slab of x, which lies a tenth of a voxel or more away from faces.
    middles = [(i, math.floor(Fraction(6, 10) + i * slope), 0) for i in range(n)]
    assert set(middles) <= set(cells)
    assert len(cells) == 1 + (n - 1) + cells[-1][1]  # one face at a time


def textbook_line(start, end):
    """Bresenham's line in 3D by rounding the exact rational point of every step, ties down."""
    delta = [b - a for a, b in zip(start, end, strict=True)]
    steps = max(map(abs, delta))
    for n in range(steps + 1):
        yield tuple(
            a + (1 if d > 0 else -1) * -((steps - 2 * n * abs(d)) // (2 * steps)) if steps else a
            for a, d in zip(start, delta, strict=True)
        )


@given(st.tuples(st.floats(0.01, 2.99), st.floats(-1.49, 1.49), st.floats(0.01, 1.99)), unit)
@settings(max_examples=100)
def test_bresenham_is_the_textbooks(origin, direction):
    d = np.array(direction) / np.linalg.norm(direction)
    cells = walk("bresenham", origin, d, 100.0, GRID)
    start = tuple(np.floor((np.array(origin) - ROI.minimum) / ROI.resolution).astype(int).tolist())
    assert cells[0] == start
    assert cells == list(textbook_line(start, cells[-1]))
    # The last voxel is where the ray leaves the grid: it touches the outer layer.
    assert any(c in (0, n - 1) for c, n in zip(cells[-1], ROI.shape, strict=True))


def test_bresenham_ends_with_the_range():
    for reach, last in ((0.5, 3), (0.8, 4)):
        cells = walk("bresenham", (0.3, 0.1, 0.6), (1.0, 0.0, 0.0), reach, GRID)
        assert cells == [(i, 6, 2) for i in range(1, last + 1)]


@pytest.mark.parametrize("method", ["dda", "bresenham"])
def test_counts_and_coverage_are_those_of_the_single_rays(method, monkeypatch):
    expected = np.zeros(ROI.shape, np.int32)
    for mount in RIG.mounts:
        directions = LIDAR.directions() @ mount.rotation.T
        found, _ = voxels_of_rays(method, mount.position, directions, LIDAR.range, GRID)
        np.add.at(expected.reshape(-1), found.astype(np.int64), 1)
    for chunk in (2**16, 64):
        monkeypatch.setattr(rays, "_CHUNK", chunk)
        counts = ray_counts(RIG, ROI, method)
        np.testing.assert_array_equal(counts, expected)
        np.testing.assert_array_equal(covered_by_rays(RIG, ROI, method), expected > 0)
    assert counts.dtype == np.int32


def test_a_field_of_view_takes_part_of_the_rays():
    left = RIG.with_lidar(replace(LIDAR, azimuth=(0.0, math.pi)))
    right = RIG.with_lidar(replace(LIDAR, azimuth=(-math.pi, 0.0)))
    both = ray_counts(left, ROI, "dda") + ray_counts(right, ROI, "dda")
    np.testing.assert_array_equal(both, ray_counts(RIG, ROI, "dda"))
    ahead = Placement("a", [Mount(1.5, 0.1, 1.1)], replace(LIDAR, azimuth=(-0.1, 0.1)))
    seen = np.flatnonzero(covered_by_rays(ahead, ROI, "dda").any(axis=(1, 2)))
    assert seen.min() == 6


FRAMES = 1000


@pytest.fixture(scope="module")
def counts():
    counts = np.random.default_rng(1).integers(0, FRAMES, ROI.shape).astype(np.int32)
    counts[counts > 0.6 * FRAMES] = 0
    counts[1, 2, 3] = FRAMES
    return counts


def test_log_miss_against_a_plain_loop_over_rays(counts):
    q, missed = 0.3, np.ones(ROI.shape)
    thin = PAPER_PLACEMENTS["pyramid_pitch"].with_lidar(Lidar(LIDAR.elevations[:3], 24))
    for mount in thin.mounts:
        for direction in thin.lidar.directions() @ mount.rotation.T:
            reach = 1.0
            for cell in walk("dda", mount.position, direction, 100.0, GRID):
                if counts[cell] > 0:
                    missed[cell] *= 1 - q * reach
                reach *= 1 - counts[cell] / FRAMES
    found = log_miss(thin, ROI, "dda", counts, FRAMES, q)
    np.testing.assert_allclose(found, np.log(missed), rtol=1e-12, atol=1e-15)
    assert (found[counts == 0] == 0).all()
    assert (found < 0).sum() > 100


def test_what_a_nearly_opaque_voxel_lets_through_is_exact():
    one = Placement("one", [Mount(-0.5, 0.1, 1.1)], lidar=Lidar((0.0,), 4))
    frames = 2**31 - 1
    counts = np.zeros(ROI.shape, np.int32)
    counts[2, 6, 4], counts[3, 6, 4] = frames - 1, 1
    found = log_miss(one, ROI, "dda", counts, frames, 0.5)[3, 6, 4]
    assert found == pytest.approx(-0.5 / frames, rel=1e-9)


def test_a_stride_thins_the_rays_and_weighs_them(counts):
    for stride in (2, 7, 720, 10**6):
        thin = thinned(RIG, stride)
        assert thin.lidar.azimuth_steps == max(1, round(720 / stride))
        weight = ray_weight(RIG, stride)
        assert weight == 720 / thin.lidar.azimuth_steps
        np.testing.assert_array_equal(
            ray_counts(RIG, ROI, "dda", azimuth_stride=stride), ray_counts(thin, ROI, "dda")
        )
        np.testing.assert_array_equal(
            log_miss(RIG, ROI, "dda", counts, FRAMES, 0.1, azimuth_stride=stride),
            weight * log_miss(thin, ROI, "dda", counts, FRAMES, 0.1),
        )
    assert thinned(RIG, 1) == RIG
    for view in ((0.0, 1.0), (-1.0, 1.0), (2.0, 4.5)):
        assert ray_weight(RIG.with_lidar(replace(LIDAR, azimuth=view)), 4) == 4
    with refused(("", "azimuth_stride", "0")):
        ray_counts(RIG, ROI, "dda", azimuth_stride=0)
    with refused(("", "azimuth", "[1.0, 1.1)")):
        thinned(RIG.with_lidar(replace(LIDAR, azimuth=(1.0, 1.1))), 10**6)
