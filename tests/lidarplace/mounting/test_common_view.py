"""Fields of view in common: closed forms, directions drawn at random, graphs, and what faces."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.mounting.common_view import CommonView, check_pairs, common_view, shares, weakest
from lidarplace.mounting.facing import facing_pairs
from lidarplace.mounting.field_of_view import NO_SLOPES, FieldOfView, field_of, pyramid, view_of
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.sight import obstacles_of
from lidarplace.mounting.vehicle import Vehicle

CAR = Vehicle.car()
NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
MAST = Mount(z=3.0)
SLOPE = math.tan(math.radians(30))


def box(azimuth_deg, elevation_deg, reach=100.0):
    low, high = np.radians(azimuth_deg).tolist()
    return field_of(Lidar(tuple(np.radians(elevation_deg)), 3600, range=reach, azimuth=(low, high)))


def cone(half_deg, reach=100.0):
    half = math.radians(half_deg)
    sine = math.sin(half)
    return FieldOfView((-half, 2 * half), (-sine, sine), math.cos(half), NO_SLOPES, reach)


def share_of(one, other, vehicle=NOTHING, at=20.0):
    views = [view_of(*one), view_of(*other)]
    return shares(views, [(0, 1)], at, [obstacles_of(vehicle, NO_HOUSINGS)] * 2)[0, 1]


def lens(first, second, apart):
    """Solid angle in both of two cones of these half angles, by Girard's theorem."""
    a, b, d = math.cos(first), math.cos(second), math.cos(apart)
    if apart >= first + second:
        return 0.0
    if apart <= abs(first - second):
        return 2 * math.pi * (1 - max(a, b))
    sa, sb, sd = math.sin(first), math.sin(second), math.sin(apart)
    return 2 * (
        math.pi
        - math.acos(d / sa / sb - a * b / sa / sb)
        - math.acos(b / sd / sa - d * a / sd / sa) * a
        - math.acos(a / sd / sb - d * b / sd / sb) * b
    )


@pytest.mark.parametrize("tilt", [0.0, 90.0])
def test_boxes_of_angles_about_one_point(tilt):
    turn = math.radians(tilt)
    low, high = box((-180, 180), (-25, 5)), box((-180, 180), (-10, 15))
    mount = Mount(z=3.0, roll=turn)
    sin = [math.sin(math.radians(angle)) for angle in (-25, 5, -10, 15)]
    expected = (sin[1] - sin[2]) / (sin[3] - sin[2])
    assert share_of((mount, low), (mount, high)) == pytest.approx(expected, abs=1e-3)
    wide = box((-60, 60), (-30, 30))
    aside = share_of((Mount(z=3.0), wide), (Mount(z=3.0, yaw=math.radians(100)), wide))
    assert aside == pytest.approx(20 / 120, abs=1e-4)
    assert share_of((Mount(z=3.0), wide), (Mount(z=3.0, yaw=math.pi), wide)) == 0.0


@pytest.mark.parametrize(("first", "second", "apart"), [(30, 20, 25), (40, 40, 50), (35, 10, 5)])
def test_cones_about_one_point(first, second, apart):
    share = share_of((MAST, cone(first)), (replace(MAST, yaw=math.radians(apart)), cone(second)))
    angles = [math.radians(angle) for angle in (first, second, apart)]
    smaller = 2 * math.pi * (1 - math.cos(min(angles[:2])))
    assert share == pytest.approx(lens(*angles) / smaller, abs=1e-3)


def test_a_camera_in_a_full_sphere_and_the_other_way_round():
    """Compare with its solid angle, 4 asin(sin(h / 2) sin(v / 2)); its box of angles has more."""
    sphere, camera = box((-180, 180), (-90, 90)), pyramid((1.0, 1.0, SLOPE, SLOPE), 50.0)
    assert share_of((MAST, camera), (Mount(0.3, 0.1, 2.9, 0.4, 1.1, 2.0), sphere)) == 1.0
    band = box((-45, 45), (-20, 20))
    solid = 4 * math.asin(math.sin(math.radians(45)) * math.sin(math.radians(30)))
    inside = share_of((MAST, band), (MAST, camera))
    assert (math.pi / 2) * 2 * math.sin(math.radians(20)) < solid
    azimuths = np.radians(np.linspace(-45, 45, 20001))
    tops = np.minimum(np.arctan(SLOPE * np.cos(azimuths)), math.radians(20))
    assert inside == pytest.approx(np.sin(tops).mean() / math.sin(math.radians(20)), abs=2e-3)


def even(one, other, vehicle, at, number=400_000):
    """The solid angle of the first field, and the share of it that both see, by directions that are
    even over it: a lattice, whose error falls faster than that of chance."""
    (mount, lidar), (_, partner) = one, other
    n, sines = np.arange(number), np.sin([min(lidar.elevations), max(lidar.elevations)])
    start, width = lidar.azimuth[0], lidar.azimuth[1] - lidar.azimuth[0]
    up = sines[0] + (n + 0.5) / number * (sines[1] - sines[0])
    azimuth = start + width * (n * (5**0.5 - 1) / 2 % 1.0)
    flat = np.sqrt(1 - up**2)
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=1)
    points = mount.position + at * rays @ mount.rotation.T

    def hidden(origin, ends):
        way, met = ends - origin, np.zeros(len(ends), bool)
        for low, high in vehicle.interior:
            t = np.sort([(low - origin) / way, (high - origin) / way], axis=0)
            met |= np.maximum(t[0].max(axis=1), 0) < np.minimum(t[1].min(axis=1), 1)
        return met

    def sees(mount, lidar, points):
        local = (points - mount.position) @ mount.rotation
        away = np.linalg.norm(local, axis=1)
        elevation = np.arcsin(local[:, 2] / away)
        azimuth = np.arctan2(local[:, 1], local[:, 0])
        start, end = lidar.azimuth
        inside = (elevation >= min(lidar.elevations)) & (elevation <= max(lidar.elevations))
        inside &= lidar.full_turn | ((azimuth - start) % (2 * math.pi) <= end - start)
        inside &= away <= lidar.reach + 1e-9
        inside[inside] = ~hidden(mount.position, points[inside])
        return inside

    seen = points[~hidden(mount.position, points)]
    solid = len(seen) / number * width * (sines[1] - sines[0])
    return solid, sees(other[0], partner, seen).mean()


def check_against_lattice(rig, vehicle, at):
    """Shares to 0.001, of the field whose solid angle is smaller."""
    shares = common_view(rig, vehicle, CommonView("all", 0.5, at))
    sensors = list(zip(rig.mounts, rig.lidars, strict=True))
    for (i, j), share in shares.items():
        one, other = (
            even(sensors[i], sensors[j], vehicle, at),
            even(sensors[j], sensors[i], vehicle, at),
        )
        small, large = sorted([one, other])
        near = [small[1]] if small[0] < 0.999 * large[0] else [small[1], large[1]]
        assert min(abs(share - estimate) for estimate in near) < 1e-3


@given(*[st.floats(-0.5, 0.5)] * 3, st.floats(-25, 10), st.floats(0.2, 3), st.floats(1, 180))
@example(0.0029415833604631847, 0.20275723086712416, 0.33107013413853037, -12.11, 0.9, 15)
@settings(max_examples=8, deadline=None)
def test_thin_strips_however_they_are_turned(roll, pitch, yaw, low, width, half):
    paper, half = Lidar.paper(), math.radians(half)
    field = replace(paper, azimuth=(-half, half), elevations=(-math.radians(5), math.radians(5)))
    ring = replace(paper, elevations=(math.radians(low), math.radians(low + width)))
    mounts = [Mount(0, 0, 3, roll, pitch, yaw), Mount(0, 1e-9, 3)]
    check_against_lattice(Placement("ring", mounts, [field, ring]), NOTHING, 20.0)


POLES = [
    [[x, y, 1.4], [x + thick, y + thick, 2.3]]
    for x, y, thick in ((-1, 0.7, 0.04), (-0.4, -0.7, 0.1), (0.3, 0.7, 0.2), (0.6, -0.6, 0.06))
]
RAIL = [[-1.5, -0.78, 1.62], [0.8, -0.75, 1.65]]


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 9])
def test_tilted_lidars_and_thin_poles_against_an_even_lattice(seed):
    random = np.random.default_rng(seed)
    roll, pitch, yaw = random.uniform(-1, 1, 3) * [math.pi / 2, math.pi / 2, math.pi]
    half = math.radians(random.uniform(15, 179))
    turning = Lidar.paper()
    fixed = replace(turning, azimuth=(-half, half), range=15.0, elevations=(-0.5, 0.0, 0.4))
    car = CAR.with_boxes(np.array([*POLES, RAIL])) if seed % 2 else CAR
    mounts = [Mount(0, 0.1, 1.6), Mount(random.uniform(-1.5, 0.8), -0.5, 1.7, roll, pitch, yaw)]
    check_against_lattice(Placement("two", mounts, [turning, fixed]), car, 10.0)


def test_thin_poles_around_a_published_rig():
    poles = [[[-1 + 0.3 * n, 0.7, 1.5], [-0.96 + 0.3 * n, 0.74, 2.4]] for n in range(6)]
    line = PAPER_PLACEMENTS["line"]
    two = Placement("two", line.mounts[:2], line.lidar)
    check_against_lattice(two, CAR.with_boxes(np.array(poles)), 20.0)


def test_a_mesh_and_round_housings():
    """A mesh of the car's boxes is the car; a round housing is as wide as its tangents."""
    corners = np.array(list(np.ndindex(2, 2, 2)))
    vertices = np.concatenate([np.take_along_axis(box, corners, axis=0) for box in CAR.boxes])
    quads = np.array(
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = Vehicle("mesh", np.empty((0, 2, 3)), Mesh(vertices, np.concatenate([faces, faces + 8])))
    square = PAPER_PLACEMENTS["square"]
    view = CommonView(((0, 1), (0, 2)), 0.5, 20.0)
    boxes = common_view(square, CAR, view)
    assert common_view(square, mesh, view) == pytest.approx(boxes, abs=1e-3)
    size, apart = (0.1, 0.1, 0.5), 0.4
    flat, tall = (replace(Lidar.paper(), elevations=(-e, e), size=size) for e in (0.05, 0.2))
    row = Placement("row", [Mount(z=3.0), Mount(apart, z=3.0)], [flat, tall])
    share = common_view(row, NOTHING, CommonView("all", 0.5, 20.0))[0, 1]
    half = math.asin(size[0] / 2 / apart)
    behind = 2 * (half + math.asin(size[0] / 2 / 20.0))  # of the first, hidden from the second
    assert share == pytest.approx(1 - behind / (2 * math.pi - 2 * half), abs=2e-4)


def test_views_without_extent_or_without_sight():
    planar, high = box((-180, 180), (0, 0)), box((-180, 180), (-20, 20))
    level = share_of((MAST, planar), (MAST, high))
    assert level == 1.0
    assert share_of((Mount(z=3.0, roll=0.5), planar), (MAST, planar)) == pytest.approx(0, abs=1e-3)
    inside = Mount(z=0.5)
    assert share_of((inside, high), (MAST, high), CAR) == 0.0
    far = share_of((MAST, high), (Mount(x=90.0, z=3.0), box((-180, 180), (-20, 20), reach=5.0)))
    assert far == 0.0
    one = PAPER_PLACEMENTS["center"]
    alone = Placement("one", one.mounts[:1], one.lidar)
    view = CommonView("chain", 0.2, 20.0)
    assert weakest(common_view(alone, CAR, view), view) == (1.0, None)


def test_pairs_that_are_named():
    rig = PAPER_PLACEMENTS["square"]
    every = common_view(rig, CAR, CommonView("all", 0.2, 20.0))
    named = CommonView(((1, 2), (0, 3)), 0.2, 20.0)
    shares = common_view(rig, CAR, named)
    assert shares == {pair: every[pair] for pair in named.pairs}
    check_pairs(named, 4)
    missing = CommonView(((0, 7),), 0.2, 20.0)
    assert weakest(common_view(rig, CAR, missing), missing) == (0.0, (0, 7))


@given(st.integers(2, 6), st.data())
def test_a_chain_holds_as_long_as_the_graph_is_connected(number, data):
    pairs = [(i, j) for j in range(number) for i in range(j)]
    shares = {pair: data.draw(st.integers(0, 20)) / 20 for pair in pairs}
    share, pair = weakest(shares, CommonView("chain", 0.5, 20.0))

    def connected(least):
        reached = {0}
        for _ in range(number):
            reached |= {
                n for pair in pairs if shares[pair] >= least and set(pair) & reached for n in pair
            }
        return len(reached) == number

    assert shares[pair] == share
    assert connected(share)
    assert not connected(share + 0.01)
    assert weakest(shares, CommonView("all", 0.5, 20.0))[0] == min(shares.values())


def rig_of(*mounts, lidar=None):
    return Placement("rig", [Mount.degrees(**mount) for mount in mounts], lidar or Lidar.paper())


LEFT, RIGHT = {"y": 0.6, "z": 1.8}, {"y": -0.6, "z": 1.8}


def test_lidars_that_look_into_each_other():
    assert facing_pairs(rig_of(LEFT, RIGHT), CAR) == [(0, 1)]
    assert facing_pairs(rig_of(LEFT), CAR) == []
    # 0.2 m higher at 1.2 m: 9.5 degrees, above the highest beam of the lower one, at 5 degrees.
    assert facing_pairs(rig_of(LEFT, RIGHT | {"z": 2.0}), CAR) == []
    assert facing_pairs(rig_of(LEFT, RIGHT | {"z": 1.9}), CAR) == [(0, 1)]  # 4.8 degrees
    assert facing_pairs(rig_of(LEFT | {"roll": -6}, RIGHT), CAR) == [(0, 1)]
    assert facing_pairs(rig_of(LEFT | {"roll": 6}, RIGHT), CAR) == []  # above its beams
    assert facing_pairs(rig_of(LEFT | {"roll": -30}, RIGHT | {"roll": 30}), CAR) == []
    assert (
        facing_pairs(rig_of(LEFT | {"z": 1.2, "y": 1.0}, RIGHT | {"z": 1.2, "y": -1.0}), CAR) == []
    )
    ahead = Lidar.even(16, azimuth_deg=(-60, 60))
    back = [LEFT | {"yaw": 90}, RIGHT | {"yaw": -90}]
    inwards = [LEFT | {"yaw": -90}, RIGHT | {"yaw": 90}]
    assert facing_pairs(rig_of(*back, lidar=ahead), CAR) == []
    assert facing_pairs(rig_of(*inwards, lidar=ahead), CAR) == [(0, 1)]
    assert facing_pairs(rig_of(inwards[0], back[1], lidar=ahead), CAR) == []


def test_other_light_or_a_housing_between_keeps_lidars_from_facing():
    red, infra = Lidar.paper(), replace(Lidar.paper(), wavelength=1550e-9)
    assert facing_pairs(rig_of(LEFT, RIGHT, lidar=[red, infra]), CAR) == []
    between = {"y": 0.0, "z": 1.8}
    sized = replace(red, size=(0.1, 0.1, 0.1))
    assert facing_pairs(rig_of(LEFT, RIGHT, between, lidar=sized), CAR) == [(0, 2), (1, 2)]
    assert len(facing_pairs(rig_of(LEFT, RIGHT, between), CAR)) == 3
