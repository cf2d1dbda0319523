"""Rays on objects: against single rays in plain Python, and properties that hold for all rigs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Lidar, Mount, Placement
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.rays_on_objects import count_cells, count_points, sights_of
from lidarplace.rigs.weather import Weather
from tests.lidarplace.requirements.brute_force import cells_of, hits_of

CAR = Vehicle.car()
NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
FULL = Lidar(tuple(np.radians([-60.0, -31.0, -20.0, -11.0, -3.0, 4.0])), azimuth_steps=97)
PART = Lidar(tuple(np.radians([10.0, -15.0, -40.0])), 90, range=9.0, min_range=2.5)
PART = replace(PART, azimuth=(math.radians(100), 4.0))
DIM = replace(FULL, range=30.0, range_10=6.0, range_80=11.0, window=0.9)
DIM = DIM.in_weather(Weather(visibility=200.0))
FOGGY = replace(FULL, range=11.0).in_weather(Weather(visibility=70.0))
CELL = 0.2

angle = st.floats(-math.pi, math.pi)
place = st.floats(-2, 2), st.floats(-1, 1), st.floats(1.51, 3)
mounts = st.builds(Mount, *place, angle, st.floats(-1.5, 1.5), angle)
rigs = st.lists(
    st.tuples(mounts, st.sampled_from([FULL, PART, FOGGY, DIM])),
    min_size=1,
    max_size=3,
    unique_by=lambda pair: (pair[0].x, pair[0].y, pair[0].z),
).map(lambda pairs: Placement("rig", *(list(each) for each in zip(*pairs, strict=True))))
# No LiDAR is on a face of a box, where rounding decides what it sees.
sizes = st.floats(0.1, 5), st.floats(0.1, 3), st.floats(0.1, 3).map(lambda height: height + 0.0029)
boxes = st.tuples(st.floats(-12, 12), st.floats(-12, 12), *sizes, angle).map(
    lambda own: np.array([[own[0] + 0.0137, own[1] + 0.0071, own[4] / 2, *own[2:]]])
)
vehicles = st.sampled_from([CAR, NOTHING])


@settings(max_examples=30)
@given(rig=rigs, box=boxes, vehicle=vehicles, reflectivity=st.floats(0.01, 1.0))
def test_counts_are_those_of_single_rays(rig, box, vehicle, reflectivity):
    hits = hits_of(rig, vehicle, box[0], reflectivity)
    sights = sights_of(rig, vehicle)
    every = range(len(hits))
    sets = [every, (), *((n,) for n in every), *(set(every) - {n} for n in every)]
    points = count_points(sights, box, reflectivity, sets)
    assert points[0].tolist() == [sum(len(hits[n]) for n in lidars) for lidars in sets]
    cells = count_cells(sights, box, CELL, reflectivity, sets)
    of_lidar = [cells_of(points_hit, box[0, 3:6], CELL) for points_hit in hits]
    unions = [set().union(*(of_lidar[n] for n in lidars)) for lidars in sets]
    assert cells[0].tolist() == [*map(len, unions)]


def test_what_is_dark_is_seen_up_to_the_range_for_its_light():
    """A LiDAR of 10 m at 10 % sees 40 % twice as far, if it faces the ray; else by the cosine."""
    lidar = Lidar((0.0,), azimuth_steps=360, range=100.0, range_10=10.0)
    sights = sights_of(Placement("one", [Mount(z=1.0)], lidar), NOTHING)

    def seen(distance, reflectivity):
        wall = np.array([[distance + 0.5, 0.0, 1.0, 1.0, 0.1, 2.0, 0.0]])
        return int(count_points(sights, wall, reflectivity)[0, 0])

    assert [seen(d, 0.1) for d in (9.99, 10.01)] == [1, 0]
    assert [seen(d, 0.4) for d in (19.99, 20.01)] == [1, 0]
    assert [seen(d, 0.025) for d in (4.99, 5.01)] == [1, 0]
    turned = np.array([[7.0, 0.0, 1.0, 0.01, 4.0, 2.0, math.pi / 3]])
    assert count_points(sights, turned, 0.1)[0, 0] > 0, "at 60 degrees up to 7.07 m"
    turned[0, 0] = 7.3
    ahead = Lidar((0.0,), 360, 100.0, range_10=10.0, azimuth=(-0.001, 0.001))
    sights = sights_of(Placement("one", [Mount(z=1.0)], ahead), NOTHING)
    assert count_points(sights, turned, 0.1)[0, 0] == 0
    assert count_points(sights, turned, 0.12)[0, 0] == 1


def test_the_body_hides_what_is_behind_it():
    """A wall of 1 m stands on the right half of the view."""
    lidar = Lidar((0.0,), azimuth_steps=360)
    rig = Placement("one", [Mount(z=1.0)], lidar)
    wall = np.array([[4.5, 0.0, 1.0, 1.0, 2.0, 2.0, 0.0]])
    screen = Vehicle("screen", np.array([[[1.0, -9.0, 0.0], [1.1, 0.0, 2.0]]]))
    # The ray straight ahead passes along the edge of the screen, which lies at y = 0.
    assert count_points(sights_of(rig, screen), wall)[0, 0] == 15
    behind = Vehicle("behind", screen.boxes + np.array([9.0, 0.0, 0.0]))
    assert count_points(sights_of(rig, behind), wall)[0, 0] == 29
    assert count_points(sights_of(rig, CAR), wall)[0, 0] == 0, "it is inside of the body"


@pytest.mark.parametrize("number", [1, 3000])
def test_many_boxes_are_counted_one_by_one(number):
    """More than a thread takes at a time."""
    rng = np.random.default_rng(1)
    many = np.tile([0.0, 0.0, 0.85, 0.5, 0.6, 1.7, 0.3], (number, 1))
    many[:, :2] = rng.uniform(-15, 15, (number, 2))
    sights = sights_of(Placement("rig", [Mount(z=2), Mount(x=1, z=2)], FULL), CAR)
    whole = count_cells(sights, many, CELL)
    for n in (0, number // 2, number - 1):
        assert whole[n] == count_cells(sights, many[[n]], CELL)[0]
