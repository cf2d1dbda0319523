"""Lines around the vehicle, from above and from a side."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.outline import closed_lines, outline
from lidarplace.mounting.vehicle import Vehicle

NO_BOXES = np.empty((0, 2, 3))


def test_boxes_have_their_sides():
    boxes = np.array([[[-2, -1, 0], [2, 1, 1]], [[-1, -0.8, 1], [1, 0.8, 2]]])
    top, (_, side) = outline(Vehicle("two", boxes)), closed_lines(Vehicle("two", boxes), (0, 2))
    corners = [[-2, -1], [2, -1], [2, 1], [-2, 1], [-2, -1]]
    np.testing.assert_array_equal(top[:5], corners)
    assert np.isnan(top[[5, 11]]).all()
    np.testing.assert_array_equal(side.max(axis=0), [1, 2])


@given(seed=st.integers(0, 1000), parts=st.integers(1, 6))
@settings(max_examples=30)
def test_a_mesh_reaches_as_far_as_its_corners_and_no_farther(seed, parts):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(0, 2, (3 * parts, 3))
    mesh = Mesh(vertices, np.arange(3 * parts).reshape(-1, 3))
    for axes in ((0, 1), (0, 2), (1, 2)):
        (line,) = closed_lines(Vehicle("mesh", NO_BOXES, mesh), axes)
        plane = vertices[:, axes]
        np.testing.assert_array_equal(line[0], line[-1])
        np.testing.assert_allclose(line[:, 0].min(), plane[:, 0].min())
        np.testing.assert_allclose(line[:, 0].max(), plane[:, 0].max())
        assert plane[:, 1].min() - 1e-9 <= line[:, 1].min()
        assert line[:, 1].max() <= plane[:, 1].max() + 1e-9
        # At each place the line is where the triangles end there, found by cutting them.
        for x, y in line[:: len(line) // 7]:
            cuts = [y for triangle in plane.reshape(-1, 3, 2) for y in cut(triangle, x)]
            assert min(abs(y - min(cuts)), abs(y - max(cuts))) < 1e-9


def cut(triangle, x):
    """Return where an upright line meets the sides of a triangle."""
    for (x0, y0), (x1, y1) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if min(x0, x1) <= x <= max(x0, x1):
            yield y0 + (y1 - y0) * (x - x0) / (x1 - x0)
