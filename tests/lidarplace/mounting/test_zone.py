"""Zones: a map from the unit cube onto them and back, candidate grids, halves."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.mounting.polygon import NANOMETRE
from lidarplace.mounting.zone import (
    Zone,
    distance,
    grid,
    left_half,
    on_centre_line,
    position,
    shares,
)
from tests.lidarplace.mounting.polygon_examples import polygons, some_points
from tests.refused import refused

ROOF = Zone("roof", ((-1, -0.6), (1, -0.4), (1, 0.4), (-1, 0.6)), (1.6, 2.0))
FORK = Zone("fork", ((0, -2), (2, -2), (2, -1), (1, -1), (1, 0), (3, 0), (3, 2), (0, 2)), (1, 1))
share = st.floats(0, 1) | st.sampled_from([0.0, 0.5, 1.0, 1e-300, 1 / 3, math.nextafter(1, 0)])
points = st.tuples(st.floats(-3, 3), st.floats(-3, 3))
degenerate = st.lists(points, min_size=1, max_size=2).map(tuple)
heights = st.tuples(st.floats(-1, 3), st.floats(0, 2) | st.just(0.0)).map(
    lambda z: (z[0], z[0] + z[1])
)
zones = st.builds(Zone, st.just("any"), polygons | degenerate, heights)


@given(zone=zones, u=share, v=share, w=share)
@settings(max_examples=80, derandomize=True)
def test_positions_lie_in_the_zone_and_come_back(zone, u, v, w):
    place = position(zone, u, v, w)
    assert distance(zone, *place) <= NANOMETRE
    back = shares(zone, *place)
    assert position(zone, *back) == pytest.approx(place, abs=2e-9)


@given(zone=zones, seed=st.integers(0, 10**6))
@settings(max_examples=80, derandomize=True)
def test_every_point_of_the_zone_is_reached(zone, seed):
    if len(zone.polygon) < 3:
        inside = list(zone.polygon)
    else:
        inside = [p for p in some_points(zone.polygon, seed) if distance(zone, *p, zone.z[0]) == 0]
        inside += list(zone.polygon)  # corners, also where the width jumps
    for x, y in inside:
        for z in zone.z:
            assert position(zone, *shares(zone, x, y, z)) == pytest.approx((x, y, z), abs=3e-9)


@given(zone=zones, low=st.tuples(share, share, share), high=st.tuples(share, share, share))
@settings(max_examples=100, derandomize=True)
def test_each_coordinate_grows_with_its_share(zone, low, high):
    u, v, w = low
    for axis in range(3):
        a, b = sorted((low[axis], high[axis]))
        first, second = [u, v, w], [u, v, w]
        first[axis], second[axis] = a, b
        assert position(zone, *first)[axis] <= position(zone, *second)[axis]


def test_shares_run_over_length_width_and_height():
    assert position(ROOF, 0.5, 0.5, 0.25) == pytest.approx((0, 0, 1.7))
    assert position(ROOF, 0.25, 0, 0) == pytest.approx((-0.5, -0.55, 1.6))
    assert position(ROOF, 1, 1, 1) == (1, 0.4, 2.0)
    assert shares(ROOF, -0.5, 0.55, 1.8) == pytest.approx((0.25, 1, 0.5))
    # Across the fork's two arms, one and two metres wide, the gap is left out.
    assert position(FORK, 0.5, 0.25, 0.5) == pytest.approx((1.5, -1.25, 1))
    assert position(FORK, 0.5, 0.5, 0.5) == pytest.approx((1.5, 0.5, 1))
    # Both ends of the gap come back, and not as each other.
    for y in (-1.0, 0.0):
        assert position(FORK, *shares(FORK, 1.5, y, 1.0)) == pytest.approx((1.5, y, 1), abs=1e-9)


def test_a_fork_is_whole_where_its_gap_begins():
    for x in (1.0, math.nextafter(1.0, 2.0)):
        place = shares(FORK, x, -0.5, 1.0)
        assert position(FORK, *place) == pytest.approx((1, -0.5, 1), abs=1e-9)


@pytest.mark.parametrize(
    "zone",
    [
        Zone.box("point", (1, 1), (0.5, 0.5), (2, 2)),
        Zone.box("across", (1, 1), (-0.5, 0.5), (2, 2)),
        Zone.box("along", (-1, 1), (0, 0), (2, 2)),
        Zone.box("mast", (0, 0), (0, 0), (1.6, 3)),
        Zone("slanted", ((0, 0.1), (0.7, 0.4)), (1, 2)),
    ],
)
def test_zones_without_width(zone):
    for place in np.random.default_rng(0).random((50, 3)):
        point = position(zone, *place)
        assert distance(zone, *point) <= NANOMETRE
        free = [zone.x[0] < zone.x[1], len({y for _, y in zone.polygon}) > 1, zone.z[0] < zone.z[1]]
        free[1] &= not free[0]  # on a slanted segment x decides y
        np.testing.assert_allclose(shares(zone, *point), np.where(free, place, 0.5), atol=1e-9)


def test_a_point_outside_is_moved_by_a_millimetre_at_most():
    assert shares(ROOF, 1.0009, 0, 1.8) == pytest.approx((1, 0.5, 0.5))
    assert shares(ROOF, 0, 0, 2.0009) == pytest.approx((0.5, 0.5, 1))
    # The tip of a needle: the nearest point, not that at the same x.
    needle = Zone("needle", ((0, 0), (1, -0.001), (1, 0.001)), (0, 0))
    assert position(needle, *shares(needle, -0.0005, 0.0005, 0)) == pytest.approx((0, 0, 0))
    with refused(("zone 'roof'", "", "(1.3, 0, 2.4), 0.5 m outside")):
        shares(ROOF, 1.3, 0.0, 2.4)
    with refused(("zone 'roof'", "", "nan")):
        shares(ROOF, math.nan, 0.0, 1.8)
    assert distance(ROOF, 1.0001, 0, 1.8) > NANOMETRE
    assert distance(ROOF, 1.0, 0.4, 2.0) <= NANOMETRE


@given(zone=zones, step=st.floats(0.05, 3))
@settings(max_examples=80, derandomize=True)
def test_grids_lie_in_the_zone(zone, step):
    points = grid(zone, step)
    assert points.shape[1] == 3
    assert len(points) > 0
    assert all(distance(zone, *point) <= NANOMETRE for point in points.tolist())
    assert len(np.unique(points, axis=0)) == len(points)


@given(zone=zones, step=st.floats(0.1, 3))
@settings(max_examples=100, derandomize=True)
def test_grids_of_mirrored_zones_are_mirrored(zone, step):
    mirrored = Zone("other", tuple((x, -y) for x, y in zone.polygon), zone.z)
    flip = grid(mirrored, step) * (1, -1, 1)
    offered = grid(zone, step)
    order = [np.lexsort(np.round(points, 6).T) for points in (offered, flip)]
    np.testing.assert_allclose(offered[order[0]], flip[order[1]], atol=1e-9)


def test_grid_of_a_box():
    points = grid(Zone.box("roof", (-1, 1), (-0.5, 0.5), (1.6, 2.0)), 0.2)
    assert len(points) == 11 * 5 * 3
    # The ends in x are multiples of the step, those in y are not.
    np.testing.assert_allclose(points.min(axis=0), [-1, -0.4, 1.6], atol=1e-12)
    np.testing.assert_allclose(points.max(axis=0), [1, 0.4, 2.0], atol=1e-12)
    np.testing.assert_array_equal(grid(ROOF, 9.0), [[0, 0, 1.8]])
    # Arms that are narrower than the step still get their middles.
    rails = Zone("rails", ((0, -1), (2, -1), (2, -0.9), (0.1, -0.9), (0.1, 0.9), (2, 0.9),
                           (2, 1), (0, 1)), (1, 1))  # fmt: skip
    np.testing.assert_allclose(grid(rails, 3.0), [[1, -0.95, 1], [1, 0.95, 1]])


@given(zone=zones, u=share, v=share, w=share)
@settings(max_examples=100, derandomize=True)
def test_halves_hold_what_is_left_and_what_is_central(zone, u, v, w):
    x, y, z = position(zone, u, v, w)
    try:
        left, centre = left_half(zone), on_centre_line(zone)
    except ValueError:  # in pieces
        return
    if y > 2e-9:
        assert distance(left, x, y, z) < 2e-9
    for part in filter(None, (left, centre)):
        place = position(part, u, v, w)
        assert distance(zone, *place) <= NANOMETRE
        assert place[1] >= 0
        assert part is left or place[1] == 0


def test_halves():
    half = left_half(ROOF)
    assert set(half.polygon) == {(-1, 0), (1, 0), (1, 0.4), (-1, 0.6)}
    assert (half.name, half.z) == ("roof", (1.6, 2.0))
    assert on_centre_line(ROOF).polygon == ((-1, 0), (1, 0))
    right = Zone.box("right", (0, 1), (-1, -0.5), (1, 2))
    assert left_half(right) is on_centre_line(right) is None
    right_side = Zone.box("right_side", (0, 1), (-1, 0), (1, 2))
    assert left_half(right_side).polygon == on_centre_line(right_side).polygon == ((0, 0), (1, 0))
    mast = Zone.box("mast", (0, 0), (0, 0), (1, 2))
    assert left_half(mast) == on_centre_line(mast) == mast
