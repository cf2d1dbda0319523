"""Meshes: rays, distances and winding numbers against all triangles, and solids that are known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.base.roi import Roi
from lidarplace.clouds.shade import ends_of
from lidarplace.mounting.body_share import body_share
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.mesh import Mesh, depths, distances, first_hit, winding_numbers
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import (
    Vehicle,
    depth_in_body,
    top_near,
    voxels_in_body,
    zone_in_body,
)
from lidarplace.mounting.zone import Zone
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

trimesh = pytest.importorskip("trimesh")
NO_BOXES = np.empty((0, 2, 3))


def box_mesh(low, high):
    """Twelve triangles, their normals outwards."""
    solid = trimesh.creation.box(bounds=[low, high])
    return Mesh(solid.vertices, solid.faces)


def of_mesh(mesh):
    return Vehicle("mesh", NO_BOXES, mesh)


def random_mesh(rng, triangles):
    corners = rng.uniform(-2, 2, (triangles, 1, 3)) + rng.normal(0, 0.5, (triangles, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3))


def hit_by_hand(mesh, origin, direction, reach):
    """Return the hit with the plane of each triangle, and the sides of its edges, in numpy."""
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - origin) * normal).sum(axis=1) / (normal @ direction)
        at = origin + t[:, None] * direction
        sides = [
            (np.cross(q - p, at - p) * normal).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))
        ]
    met = (t > 1e-9) & (t < reach) & (np.array(sides) >= 0).all(axis=0)
    return t[met].min(initial=reach)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), triangles=st.sampled_from([1, 2, 4, 5, 17, 300]))
def test_rays_meet_the_nearest_triangle(seed, triangles):
    rng = np.random.default_rng(seed)
    mesh = random_mesh(rng, triangles)
    for _ in range(60):
        origin, direction = rng.uniform(-4, 4, 3), rng.normal(size=3)
        if rng.random() < 0.2:
            direction[rng.integers(3)] = 0.0
        reach = float(rng.choice([np.inf, 3.0]))
        hit = first_hit(origin, *direction, reach, mesh.tree)
        assert hit == pytest.approx(hit_by_hand(mesh, origin, direction, reach), rel=1e-9)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), triangles=st.sampled_from([1, 3, 9, 100]))
def test_distances_are_those_of_trimesh(seed, triangles):
    rng = np.random.default_rng(seed)
    mesh, places = random_mesh(rng, triangles), rng.uniform(-4, 4, (20, 3))
    closest, faces = trimesh.triangles.closest_point, len(mesh.faces)
    expected = [
        np.linalg.norm(closest(mesh.triangles, np.tile(place, (faces, 1))) - place, axis=1)
        for place in places
    ]
    np.testing.assert_allclose(distances(mesh.tree, places), np.min(expected, axis=1), atol=1e-9)


def test_inside_of_solids_that_are_known():
    rng = np.random.default_rng(1)
    places = rng.uniform(-2.5, 2.5, (1000, 3))
    ball, ring = trimesh.creation.icosphere(4, 1.5), trimesh.creation.torus(1.4, 0.6, 48, 32)
    for solid in (ball, ring):
        mesh = Mesh(solid.vertices, solid.faces)
        numbers = winding_numbers(mesh, places)
        exact = np.array([exact_winding(mesh, place) for place in places[:100]])
        np.testing.assert_allclose(numbers[:100], exact, atol=0.01)
        np.testing.assert_array_equal(numbers[:100] > 0.5, np.abs(exact) > 0.5)
        turned = Mesh(solid.vertices, solid.faces[:, ::-1])
        np.testing.assert_allclose(winding_numbers(turned, places), numbers, atol=1e-9)
    depth = depths(Mesh(ball.vertices, ball.faces), places)
    radius = np.linalg.norm(places, axis=1)
    np.testing.assert_allclose(depth, np.maximum(1.5 - radius, 0), atol=0.01)


def exact_winding(mesh, place):
    """Return winding numbers by the spherical excess of each triangle, by its angles (Girard)."""
    corners = mesh.triangles - place
    corners = corners / np.linalg.norm(corners, axis=2, keepdims=True)
    excess = -np.pi
    for k in range(3):
        a, b, c = corners[:, k], corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        u, v = np.cross(a, b), np.cross(a, c)
        cosine = (u * v).sum(axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        excess = excess + np.arccos(np.clip(cosine, -1, 1))
    sign = np.sign((np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum(axis=1))
    return abs((sign * excess).sum()) / (4 * math.pi)


def test_a_box_of_triangles_is_a_box():
    box = Vehicle("box", np.array([[[-2.0, -1.0, 0.0], [2.0, 1.0, 1.5]]]))
    mesh = of_mesh(box_mesh([-2.0, -1.0, 0.0], [2.0, 1.0, 1.5]))
    rng = np.random.default_rng(3)
    places = rng.uniform(-3, 3, (500, 3))
    np.testing.assert_allclose(depth_in_body(mesh, places), depth_in_body(box, places), atol=1e-9)
    roi = Roi((-3, 3), (-2, 2), (0, 2), 0.25)
    np.testing.assert_array_equal(voxels_in_body(mesh, roi), voxels_in_body(box, roi))
    lidar = Lidar(tuple(np.radians(np.linspace(-60, 40, 21))), 361)
    for mount in (Mount(0.11, 0.2, 1.81, 0.2, 0.1, 0.3), Mount(2.4, 0.3, 0.7), Mount(z=0.5)):
        assert body_share(mount, lidar, mesh) == body_share(mount, lidar, box)
        rig = Placement("one", [mount], lidar)
        of_mesh_, of_box = (seen_in_columns(rig, vehicle, roi) for vehicle in (mesh, box))
        np.testing.assert_array_equal(of_mesh_[0], of_box[0])
        np.testing.assert_array_equal(of_mesh_[1], of_box[1])
    for zone, expected in (
        (Zone.box("in", (-1, 1), (-0.5, 0.5), (0.2, 1.4)), (True, True)),
        (Zone.box("partly", (-1, 1), (-0.5, 0.5), (1.4, 1.6)), (True, False)),
        (Zone.box("above", (-1, 1), (-0.5, 0.5), (1.5, 1.6)), (False, False)),
    ):
        assert zone_in_body(zone, mesh) == zone_in_body(zone, box) == expected
    for x in ((0, 0), (-3, -1), (2.5, 4)):
        assert top_near(mesh, x, (0, 0)) == top_near(box, x, (0, 0)) == 1.5


def test_no_ray_passes_between_triangles_that_share_an_edge_or_a_corner():
    grid = np.linspace(-1, 1, 9)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(81)], axis=1)
    at = np.arange(81).reshape(9, 9)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    sheet = Mesh(vertices, faces)
    aims = [*vertices, *(0.5 * (vertices[a] + vertices[c])), *(0.5 * (vertices[a] + vertices[b]))]
    inner = [aim for aim in aims if np.abs(aim).max() < 0.99]
    for origin in np.random.default_rng(0).normal(size=(20, 3)) * [3, 3, 1] + [0, 0, 2.5]:
        for aim in inner:
            t = first_hit(origin, *(aim - origin), 2.0, sheet.tree)
            assert t == pytest.approx(1.0, abs=1e-9)
    along = first_hit(np.array([-3.0, 0.0, 0.0]), 1.0, 0.0, 0.0, 100.0, sheet.tree)
    assert along == 100.0  # in its plane


def test_a_mount_a_millimetre_off_and_on_the_surface():
    roof = of_mesh(box_mesh([-2.0, -1.0, 0.0], [2.0, 1.0, 1.5]))
    down, level = Lidar((math.radians(-89),), 36), Lidar((0.0,), 36)
    for height, inside in ((1.501, False), (1.5 + 1e-7, False), (1.5, False), (1.499, True)):
        assert (depth_in_body(roof, np.array([[0, 0, height]]))[0] > 0) == inside
        assert body_share(Mount(z=height), down, roof) == 1
        # A ray that skims the roof meets the edges of its sides, which belong to them.
        assert body_share(Mount(z=height), level, roof) == float(height <= 1.5)
    assert depth_in_body(roof, np.array([[0, 0, 1.499]]))[0] == pytest.approx(0.001)
    ends = ends_of(Mount(z=1.501), down, NO_HOUSINGS, roof)
    np.testing.assert_allclose(1 / ends, 0.001 / math.sin(math.radians(89)), rtol=1e-9)


def test_triangles_without_area_are_left_out():
    flat = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    mesh = Mesh(np.array([*flat, [0, 1, 0]], float), np.array([[0, 1, 2], [0, 0, 1], [0, 1, 3]]))
    assert mesh.faces.tolist() == [[0, 1, 3]]


def test_an_open_surface_stops_rays_from_both_sides():
    sheet = of_mesh(Mesh(np.array([[9.0, -9, 0], [9, 9, 0], [-9, 0, 0]]), np.array([[0, 1, 2]])))
    up, down = Lidar((math.radians(80),), 12), Lidar((math.radians(-80),), 12)
    assert body_share(Mount(x=3, z=0.5), down, sheet) == body_share(Mount(x=3, z=-0.5), up, sheet)
    assert body_share(Mount(x=3, z=0.5), down, sheet) == 1
    assert body_share(Mount(x=3, z=0.5), up, sheet) == 0
    assert depth_in_body(sheet, np.array([[3, 0, 0.001], [3, 0, -0.001]])).max() == 0


def test_a_coarse_mesh_is_close_to_the_fine_one():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=1.5)
    mesh = Mesh(ball.vertices, ball.faces)
    coarse = mesh.coarse(0.2)
    assert len(coarse.faces) < 0.7 * len(mesh.faces)
    assert distances(mesh.tree, coarse.vertices).max() < 0.1
    aside = Mesh(ball.vertices + 2.0, ball.faces)
    assert aside.coarse(100.0) is aside
