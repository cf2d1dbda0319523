"""Polygons: what is simple, sections against counted crossings, nearest points, halves."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.mounting.polygon import above_x_axis, nearest, polygon, sections
from tests.lidarplace.mounting.polygon_examples import (
    away_from,
    counted_inside,
    polygons,
    some_points,
)


@given(vertices=polygons, axis=st.sampled_from([0, 1]), seed=st.integers(0, 10**6))
@settings(max_examples=80, derandomize=True)
def test_sections_hold_what_is_inside(vertices, axis, seed):
    for point in some_points(vertices, seed):
        intervals = sections(vertices, axis, point[axis])
        assert all(a[1] < b[0] for a, b in pairwise(intervals))
        inside = any(low <= point[1 - axis] <= high for low, high in intervals)
        assert inside == counted_inside(vertices, *point)


@given(vertices=polygons, seed=st.integers(0, 10**6))
@settings(max_examples=100, derandomize=True)
def test_nearest_point_is_at_the_boundary_or_the_point_itself(vertices, seed):
    for x, y in some_points(vertices, seed, 10):
        foot = nearest(vertices, x, y)
        if counted_inside(vertices, x, y):
            assert foot == (x, y)
        else:
            assert math.dist(foot, (x, y)) == pytest.approx(away_from(vertices, x, y), abs=1e-12)


def test_sections_through_corners_edges_and_tips():
    notched = polygon([(0, 0), (4, 0), (4, 1), (2, 1), (2, 2), (4, 2), (4, 3), (0, 3)])
    assert sections(notched, 0, 2.0) == [(0, 3)]  # along the edge of the notch, which belongs to it
    assert sections(notched, 0, 3.0) == [(0, 1), (2, 3)]
    assert sections(notched, 1, 1.0) == [(0, 4)]
    assert sections(notched, 1, 1.5) == [(0, 2)]
    assert sections(notched, 0, 4.5) == []
    trident = polygon([(0, 0), (2, 0), (1, 1), (3, 2), (1, 3), (2, 4), (0, 4)])
    assert sections(trident, 0, 2.0) == [(0, 0), (1.5, 2.5), (4, 4)]


def test_degenerate_polygons_are_segments_and_points():
    assert polygon([(1, 2)]) == polygon([(1, 2), (1, 2), (1, 2)]) == ((1, 2),)
    assert polygon([(0, 0), (2, 2), (1, 1), (0, 0)]) == ((0, 0), (2, 2))
    assert polygon([(0, 1), (0.3, 1), (0.3, 1), (0, 1)]) == ((0, 1), (0.3, 1))
    slanted = polygon([(0, 0.1), (0.3, 0.7)])
    [(low, high)] = sections(slanted, 0, 0.1)
    assert low == high == pytest.approx(0.3)
    assert sections(polygon([(1, 0), (1, 2)]), 0, 1.0) == [(0, 2)]
    assert sections(polygon([(1, 2)]), 0, 1.0) == [(2, 2)]


def test_a_polygon_is_kept_as_given():
    vertices = ((0.1, 0.2), (1.7, 0.2), (1.7, 0.9), (0.9, 0.4), (0.1, 0.9))
    assert polygon(vertices) == vertices
    assert polygon((*vertices, vertices[0])) == vertices  # closed
    assert polygon((vertices[0], *vertices)) == vertices  # twice the same
    assert polygon([(1 / 3, 0)]) == ((0.333333333, 0),)


@given(vertices=polygons, seed=st.integers(0, 10**6))
@settings(max_examples=80, derandomize=True)
def test_the_part_above_the_axis(vertices, seed):
    try:
        part = above_x_axis(vertices)
    except ValueError:
        # Then pieces stand on several intervals of the axis.
        assert len(sections(vertices, 1, 0.0)) > 1
        return
    assert (part is None) == all(y <= 0 for _, y in vertices)
    for x, y in some_points(vertices, seed):
        in_part = part is not None and nearest(part, x, y) == (x, y)
        # Vertices on y = 0 are rounded, so a point a hair away from an edge may change sides.
        assert abs(y) < 1e-7 or in_part == (y > 0 and counted_inside(vertices, x, y))


@pytest.mark.parametrize(
    ("vertices", "expected"),
    [
        # An arch on two legs: one piece above.
        (
            [(0, -1), (1, -1), (1, 1), (2, 1), (2, -1), (3, -1), (3, 2), (0, 2)],
            {(0, 0), (1, 0), (1, 1), (2, 1), (2, 0), (3, 0), (3, 2), (0, 2)},
        ),
        # A step on the axis: its edge at y = 0 bounds nothing above.
        ([(0, -1), (3, -1), (3, 0), (1, 0), (1, 1), (0, 1)], {(0, 0), (1, 0), (1, 1), (0, 1)}),
        # A tip that comes up to the axis from below, beside the part above.
        ([(0, -1), (3, -1), (2, 0), (1, -0.5), (1, 1), (0, 1)], {(0, 0), (1, 0), (1, 1), (0, 1)}),
        ([(0, 0), (1, 0), (1, -1), (0, -1)], None),
        ([(0, -1), (0, 1)], {(0, 0), (0, 1)}),
    ],
)
def test_halves_of_awkward_polygons(vertices, expected):
    part = above_x_axis(polygon(vertices))
    assert (part and set(part)) == expected
