"""Positions of objects around a mesh: against boxes, and against points in both."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.slices import meets_slices, slices_of
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area, distance_from, grid_over, in_the_way
from lidarplace.requirements.presets.read import PRESETS, preset
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

LOW, HIGH = (-2.0, -0.8, 0.3), (2.2, 0.9, 1.5)
BOX = Vehicle("box", np.array([[LOW, HIGH]]))
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([half for a, b, c, d in QUADS for half in ((a, b, c), (a, c, d))])
MESH = Vehicle("mesh", np.empty((0, 2, 3)), Mesh(np.where(CORNERS > 0, HIGH, LOW), FACES))


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1), height=st.floats(0.1, 2.0), heading=st.floats(-math.pi, math.pi)
)
def test_a_box_of_triangles_is_in_the_way_like_a_box(seed, height, heading):
    rng = np.random.default_rng(seed)
    points, size = rng.uniform(-4, 4, (200, 2)), (*rng.uniform(0.01, 2.0, 2), height)
    expected = in_the_way(BOX, points, size, heading)
    np.testing.assert_array_equal(in_the_way(MESH, points, size, heading), expected)
    assert expected.any() == (height > 0.3) or not expected.any()


def test_a_touch_is_not_in_the_way():
    size = (1.0, 1.0, 1.0)
    for gap, met in ((-1e-6, True), (0.0, False), (1e-6, False)):
        points = np.array([[2.7 + gap, 0.0], [0.0, 1.4 + gap]])
        assert in_the_way(MESH, points, size, 0.0).tolist() == [met, met]
    under = (1.0, 1.0, 0.3)
    assert not in_the_way(MESH, np.zeros((1, 2)), under, 0.0).any()
    assert in_the_way(MESH, np.zeros((1, 2)), (0.1, 0.1, 0.6), 0.0).all()  # within, no side is met


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_slices_hold_the_points_of_a_triangle_between_two_heights(seed):
    rng = np.random.default_rng(seed)
    triangle = rng.uniform(-2, 2, (1, 3, 3))
    low, high = np.sort(rng.uniform(-2, 2, 2))
    shares = rng.dirichlet([0.7] * 3, 4000)
    inside = shares @ triangle[0]
    inside = inside[(inside[:, 2] > low + 0.02) & (inside[:, 2] < high - 0.02)]
    polygons, corners = slices_of(triangle, low, high)
    half = rng.uniform(0.05, 1.0, 2)
    points, heading = rng.uniform(-2, 2, (100, 2)), float(rng.uniform(-3, 3))
    c, s = math.cos(heading), math.sin(heading)
    away = inside[None, :, :2] - points[:, None]
    along, aside = c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]
    holds = ((np.abs(along) < half[0]) & (np.abs(aside) < half[1])).any(axis=1)
    met = meets_slices(points, *half, heading, polygons, corners)
    assert (met | ~holds).all()  # where a point of both is known, they meet
    # A little smaller, and nothing but the corners between the samples is left to differ.
    smaller = meets_slices(points, *(0.8 * half - 0.02), heading, polygons, corners)
    if len(inside) > 2000:
        assert (holds | ~smaller).mean() > 0.9


def test_distances_areas_and_presets_are_those_of_the_box():
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-6, 6, (2, 40, 30))
    np.testing.assert_allclose(distance_from(MESH, x, y), distance_from(BOX, x, y), atol=1e-9)
    area = Area(distance=(0.5, 3.0))
    of_mesh, other = (grid_over(area, vehicle, 0.5) for vehicle in (MESH, BOX))
    np.testing.assert_array_equal(of_mesh.held, other.held)
    for name in PRESETS:
        assert preset(name, MESH) == preset(name, BOX)


def test_rays_that_a_mesh_stops_do_not_count():
    lidar = Lidar(tuple(np.radians(np.linspace(-60, 20, 41))), 720)
    rng = np.random.default_rng(4)
    boxes = np.column_stack(
        [*rng.uniform(-7, 7, (2, 50)), np.full(50, 0.5), rng.uniform(0.3, 1, (50, 3)), np.ones(50)]
    )
    far = ~in_the_way(BOX, boxes[:, :2], (1.5, 1.5, 1.0), 0.0)
    for mount in (Mount(0.31, 0.12, 1.7, 0.1, 0.2, 0.3), Mount(2.4, 0.9, 0.8, yaw=0.7)):
        rig = Placement("one", [mount], lidar)
        of_mesh, other = (count_points(sights_of(rig, v), boxes[far]) for v in (MESH, BOX))
        np.testing.assert_array_equal(of_mesh, other)
        assert other.sum() > 0
