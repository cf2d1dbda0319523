"""Fog and rain: extinction, the range that is left, and rays that drops send back."""

import math
import warnings
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.clouds.droplets import DROPS, drop_reflectivity, scatter_back, sight_of_drops
from lidarplace.clouds.raycast import GROUND, Hits
from lidarplace.clouds.shapes import bricks
from lidarplace.coverage import covered_bits
from lidarplace.coverage.tiles import Tiles
from lidarplace.rigs.weather import Weather, fog_extinction, rain_extinction, shortened
from tests.lidarplace.from_a_car import cast

BEAMS = tuple(np.radians(np.linspace(-20, 5, 6)))
PLAIN = Lidar(BEAMS, 900, range=120.0)
GRADED = Lidar(BEAMS, 900, range=150.0, range_10=50.0, range_80=130.0)
FOG = Weather(visibility=100.0)
EXTREME = [0.0, 5e-324, 1e-300, 1e-9, 1e-3, 1.0, 77.7, 1e4, 1e9, 1e300]


@pytest.mark.parametrize("fading", EXTREME)
def test_a_shortened_range_is_lamberts_w(fading):
    with mpmath.workdps(60), warnings.catch_warnings():
        warnings.simplefilter("error")
        for distance in EXTREME:
            exact = mpmath.mpf(distance)
            if fading > 0:
                c = mpmath.mpf(fading)
                exact = mpmath.lambertw(c * exact) / c
            found = float(shortened(distance, fading))
            assert abs(found - exact) <= 1e-15 * exact, (distance, fading)
        assert shortened(math.inf, fading) == math.inf


@pytest.mark.parametrize("visibility", [1e-3, 1.0, 499.9, 1e3, 6e3, 5e4, 1e9, math.inf])
@pytest.mark.parametrize("lidar", [PLAIN, GRADED, replace(PLAIN, range=math.inf)])
def test_no_visibility_is_too_extreme(visibility, lidar):
    dim = lidar.in_weather(Weather(visibility, rain=1e-3))
    sight = dim.sight([0.0, 1e-300, 0.1, 0.8, 20.0])
    assert (sight[1:] >= sight[:-1]).all()
    assert (sight <= lidar.sight([0.0, 1e-300, 0.1, 0.8, 20.0])).all()
    assert 0 < dim.reach <= lidar.range
    assert 0 <= sight_of_drops(dim) <= dim.range


@pytest.mark.parametrize(
    ("visibility", "nanometres", "exponent"),
    [(200, 905, 0), (200, 1550, 0), (800, 905, 0.3), (2e3, 1550, 0.66), (2e4, 905, 1.3)],
)
def test_fog_by_kims_table(visibility, nanometres, exponent):
    decibels = 10 * math.log10(math.e) * 1000 * fog_extinction(visibility, 1e-9 * nanometres)
    # 10 lg e times 3.91 is 17: decibels a kilometre of a visibility of a kilometre.
    expected = 17.0 / (visibility / 1000) * (nanometres / 550) ** -exponent
    assert decibels == pytest.approx(expected, rel=1e-3)
    # At the visibility a fiftieth of the contrast is left.
    assert math.exp(-300.0 * fog_extinction(300.0, 905e-9)) == pytest.approx(0.02, rel=1e-12)


@pytest.mark.parametrize("rain", [0.1, 5.0, 50.0])
def test_rain_is_the_sum_over_marshalls_and_palmers_drops(rain):
    def of_diameter(millimetres):
        number = 8000 * math.exp(-4.1 * rain**-0.21 * millimetres)
        return 2 * number * math.pi * (0.5e-3 * millimetres) ** 2

    expected, _ = quad(of_diameter, 0, math.inf, epsabs=1e-12)
    assert rain_extinction(rain) == pytest.approx(expected, rel=1e-6)
    # What ITU-R P.1814 has for light: 1.58 rain^0.63 decibels a kilometre.
    assert 4343 * rain_extinction(rain) == pytest.approx(1.58 * rain**0.63, rel=0.01)


reflected = st.floats(1e-3, 2.0)
weather = st.builds(Weather, visibility=st.floats(5, 1e5), rain=st.floats(0, 100))


@given(reflected, weather, st.sampled_from([1.0, 0.7]))
def test_at_the_limit_as_much_light_comes_back_as_in_clear_air(bright, air, window):
    """By the received power: r R^(-1/k) exp(-2 s R), twice through the window."""
    lidar = replace(GRADED, range=1e6, window=window)
    dim = lidar.in_weather(air)
    k = math.log(130 / 50) / math.log(8)
    far = float(dim.sight(bright))
    power = bright * far ** (-1 / k) * math.exp(-2 * dim.extinction * far) * window**2
    assert power == pytest.approx(0.1 * 50.0 ** (-1 / k), rel=1e-9)
    # Where no range is known by light, it thins by the square of the distance.
    plain = replace(PLAIN, window=window).in_weather(air)
    power = plain.reach**-2 * math.exp(-2 * plain.extinction * plain.reach) * window**2
    assert power == pytest.approx(120.0**-2, rel=1e-9)
    assert plain.sight(bright) == plain.reach


def test_clear_air_and_a_clean_window_take_nothing():
    for lidar in (PLAIN, GRADED):
        assert lidar.in_weather(Weather()) == lidar
        assert lidar.in_weather(FOG).in_weather(Weather()) == lidar
        assert lidar.reach == lidar.range


def test_coverage_ends_at_the_reach():
    roi = Roi((0, 60), (-5, 5), (0, 3), 0.5)
    rig = Placement("rig", [Mount(z=2.0)], PLAIN)
    near = replace(rig, lidar=replace(PLAIN, range=PLAIN.in_weather(FOG).reach))
    tiles = Tiles.whole(roi.shape)
    rigs = (rig.in_weather(FOG), near, rig)
    for method in ("cone", "dda"):
        seen, expected, clear = (covered_bits(each, roi, method, tiles) for each in rigs)
        np.testing.assert_array_equal(seen, expected)
        assert np.bitwise_count(seen).sum() < np.bitwise_count(clear).sum()


def test_drops_send_rays_back_as_poisson_has_it():
    lidar = Lidar(BEAMS, 100_000, range=120.0, min_range=1.0).in_weather(FOG)
    far = sight_of_drops(lidar)
    hits = Hits(*(np.full(lidar.rays, value) for value in (math.inf, -5, 0.0)))
    hits = hits._replace(target=hits.target.astype(np.int32))
    wall = 0.5 * far
    hits.range[: lidar.rays // 2] = wall
    scatter_back(lidar, hits, (3, 5, 0))
    for half, end in ((slice(lidar.rays // 2), wall), (slice(lidar.rays // 2, None), far)):
        met = hits.target[half] == DROPS
        expected = 1 - math.exp(-lidar.extinction * (end - 1.0))
        error = math.sqrt(expected * (1 - expected) / len(met))
        assert abs(met.mean() - expected) < 4 * error
        distances = hits.range[half][met]
        assert distances.min() >= 1.0
        assert distances.max() < end
        below = 1 - math.exp(-lidar.extinction * (distances.mean() - 1.0))
        assert 0.3 * expected < below < 0.6 * expected
        assert (hits.reflected[half][met] == drop_reflectivity(lidar.extinction)).all()
    again = Hits(np.full(lidar.rays, math.inf), hits.target.copy(), hits.reflected.copy())
    scatter_back(lidar, again, (3, 5, 0))
    rest = slice(lidar.rays // 2, None)
    np.testing.assert_array_equal(again.range[rest], hits.range[rest])


def test_fog_of_thousand_metres_returns_little_and_clear_air_nothing():
    lidar = replace(GRADED, azimuth_steps=9000)
    car = bricks(np.array([[12.0, 0.0, 0.75, 4.0, 1.8, 1.5, 0.0]]), 0)
    shares = []
    for air in (Weather(), Weather(1000.0), Weather(100.0), Weather(20.0)):
        dim = lidar.in_weather(air)
        hits = cast(Mount(z=2.0), dim, car)
        assert (hits.target == GROUND).any()
        scatter_back(dim, hits, (0, 0, 0))
        shares.append(float((hits.target == DROPS).mean()))
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert 0 < shares[1] < 0.05
