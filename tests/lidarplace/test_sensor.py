import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace import Lidar
from lidarplace.configuration.sensor import SensorSettings
from tests.refused import refused

BEAMS = (-0.2, 0.1)


def test_a_full_turn_fires_every_step():
    lidar = Lidar(BEAMS, azimuth_steps=12)
    assert lidar.full_turn
    assert (lidar.first_step, lidar.fired_steps, lidar.rays) == (0, 12, 24)
    np.testing.assert_array_equal(lidar.azimuths(), np.arange(12) * (2 * math.pi / 12))
    for other in ((0.0, 2 * math.pi), (-1.0, 2 * math.pi - 1.0)):
        turned = replace(lidar, azimuth=other)
        assert turned.full_turn
        np.testing.assert_array_equal(turned.directions(), lidar.directions())


def test_a_thinned_lidar_has_fewer_azimuth_steps_and_nothing_else():
    lidar = Lidar(BEAMS, azimuth_steps=5625, range=30.0, azimuth=(-1.0, 1.0))
    assert lidar.thinned(0.16) == replace(lidar, azimuth_steps=900)
    assert lidar.thinned(1) == lidar
    assert Lidar(BEAMS, azimuth_steps=12).thinned(1e-9).azimuth_steps == 1
    third = Lidar(BEAMS, 600, azimuth=(math.radians(-60), math.radians(60)))
    assert [third.thinned(1 / n).fired_steps for n in (1, 2, 4, 5, 8)] == [200, 100, 50, 40, 25]


@pytest.mark.parametrize(
    ("degrees", "steps"),
    [
        ((-60, 60), [10, 11, 0, 1]),  # the first end is fired, the last is not
        ((120, 240), [4, 5, 6, 7]),  # crosses 180 degrees
        ((720, 750), [0]),
    ],
)
def test_steps_within_the_field_of_view(degrees, steps):
    low, high = (math.radians(d) for d in degrees)
    lidar = Lidar(BEAMS, azimuth_steps=12, azimuth=(low, high))
    assert not lidar.full_turn
    np.testing.assert_array_equal(lidar.azimuths(), np.array(steps) * (2 * math.pi / 12))
    rays = Lidar(BEAMS, azimuth_steps=12).directions().reshape(2, 12, 3)
    np.testing.assert_array_equal(lidar.directions(), rays[:, steps].reshape(-1, 3))


@given(st.integers(1, 50), st.floats(-10, 10), st.floats(1e-3, 2 * math.pi))
def test_each_fired_azimuth_is_in_the_field_of_view(steps, low, width):
    full = np.arange(steps) * (2 * math.pi / steps)
    inside = np.mod(full - low, 2 * math.pi)
    distance = np.minimum(np.abs(inside - width), np.minimum(inside, 2 * math.pi - inside))
    if (distance < 1e-9).any():  # an end on a step: either side is right up to rounding
        return
    expected = full[inside < width]
    if not len(expected):
        with refused(("", "azimuth", f"[{low}, {low + width})")):
            Lidar(BEAMS, steps, azimuth=(low, low + width))
        return
    found = Lidar(BEAMS, steps, azimuth=(low, low + width)).azimuths()
    np.testing.assert_array_equal(np.sort(found), expected)


@given(
    st.integers(2, 700).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, n - 1))),
    st.floats(-2 * math.pi, 2 * math.pi),
    st.integers(-2000, 2000),
)
def test_a_width_in_steps_is_the_number_of_steps_wherever_it_begins(steps, low, first):
    (turn, width), step = steps, 2 * math.pi / steps[0]
    for begin in (low, first * step):
        lidar = Lidar(BEAMS, turn, azimuth=(begin, begin + width * step))
        assert lidar.fired_steps == width


@given(
    st.floats(-2 * math.pi, 2 * math.pi), st.integers(1, 500), st.floats(0, 1), st.floats(0.01, 1)
)
def test_neighbouring_fields_of_view_share_no_step_and_lose_none(low, turn, cut, width):
    width *= 2 * math.pi * (1 - 1e-9)
    middle, high = low + cut * width, low + width

    def fired(start, end):
        try:
            return Lidar(BEAMS, turn, azimuth=(start, end)).azimuths().tolist()
        except ValueError:  # no step in it, or no width
            return []

    assert fired(low, middle) + fired(middle, high) == fired(low, high)


def test_even_beams_in_degrees():
    lidar = Lidar.even(beams=3, elevation_deg=(-20, 10), azimuth_deg=(-60, 60), range=30)
    np.testing.assert_allclose(np.degrees(lidar.elevations), [-20, -5, 10])
    assert lidar == replace(lidar, azimuth_steps=5625, azimuth=np.radians([-60, 60]), range=30.0)
    assert Lidar.even() == Lidar.paper() == SensorSettings().lidar()
    assert Lidar.even(1, (-3, 5), 90) == Lidar((math.radians(-3),), 90)
    listed, plain = Lidar(BEAMS, 12, azimuth=[0, 1]), Lidar(BEAMS, 12, azimuth=(np.float64(0), 1.0))
    assert listed == plain
    assert hash(listed) == hash(plain), "a tuple read from JSON is a list"


def test_how_far_surfaces_are_seen():
    light = np.array([0.0, 0.05, 0.1, 0.4, 0.8, 1.0, 100.0])
    np.testing.assert_array_equal(Lidar(BEAMS, 12, range=70).sight(light), 70)
    inverse_square = Lidar(BEAMS, 12, range=200, range_10=50)
    expected = [0, 50 / math.sqrt(2), 50, 100, 50 * math.sqrt(8), 50 * math.sqrt(10), 200]
    np.testing.assert_allclose(inverse_square.sight(light), expected, rtol=1e-12)
    hazy = replace(inverse_square, range_80=100.0)  # twice as far by eight times the light
    np.testing.assert_allclose(hazy.sight([0.1 / 8, 0.1, 0.8, 6.4]), [25, 50, 100, 200])
    same = replace(inverse_square, range_80=50.0)
    np.testing.assert_array_equal(same.sight(light), 50)


def test_a_lidar_is_shown_in_a_line():
    whole = Lidar.even(beams=16, elevation_deg=(-25, 5), azimuth_steps=900)
    shown = "Lidar(16 beams, -25 to 5 degrees, 900 azimuth steps a turn, range 100 m)"
    assert repr(whole) == shown
    part = replace(whole, azimuth=(math.radians(-60), math.radians(60)))
    assert "azimuth -60 to 60 degrees" in repr(part)
