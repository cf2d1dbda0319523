"""Truncation against shapes whose areas are known, and against counted points."""

import math

import numpy as np
import pytest

from lidarplace.clouds.truncation import truncation

X, Y = (0.0, 40.0), (-20.0, 20.0)


@pytest.mark.parametrize(
    ("box", "share"),
    [
        ((20, 0, 4, 2, 0.0), 0.0),
        ((20, 0, 4, 2, 0.7), 0.0),
        ((-20, 0, 4, 2, 0.7), 1.0),
        ((0, 0, 4, 2, 0.0), 0.5),
        ((0, 0, 4, 2, 0.3), 0.5),  # an edge through the centre halves it at any yaw
        ((1, 0, 4, 2, 0.0), 0.25),
        ((40, 20, 2, 2, 0.0), 0.75),
        ((40, 20, math.sqrt(2), math.sqrt(2), math.pi / 4), 0.75),
        ((20, 0, 80, 80, 0.0), 0.75),  # the region lies within the box
        ((40, 0, 2, 2, math.pi / 4), 0.5),
        ((38, 0, 4, 4, 0.0), 0.0),  # flush with the edge
        ((10, 0, 0, 2, 0.0), 0.0),
        ((-1, 0, 4, 0, 0.0), 1.0),
        ((0, 0, 0, 0, 0.0), 0.0),
    ],
)
def test_known_areas(box, share):
    x, y, length, width, yaw = box
    row = np.array([[x, y, 1.0, length, width, 2.0, yaw]])
    assert truncation(row, X, Y)[0] == pytest.approx(share, abs=1e-12)


def test_agrees_with_counted_points():
    rng = np.random.default_rng(0)
    boxes = np.column_stack(
        [
            rng.uniform(-3, 43, 40),
            rng.uniform(-23, 23, 40),
            np.ones(40),
            *rng.uniform(0.5, 12, (2, 40)),
            np.ones(40),
            rng.uniform(-4, 4, 40),
        ]
    )
    grid = (np.arange(400) + 0.5) / 400 - 0.5
    u, v = (a.ravel() for a in np.meshgrid(grid, grid))
    for box, share in zip(boxes, truncation(boxes, X, Y), strict=True):
        c, s = math.cos(box[6]), math.sin(box[6])
        x, y = box[0] + c * u * box[3] - s * v * box[4], box[1] + s * u * box[3] + c * v * box[4]
        outside = (x < X[0]) | (x > X[1]) | (y < Y[0]) | (y > Y[1])
        assert share == pytest.approx(outside.mean(), abs=5e-3)


def test_a_box_that_no_edge_cuts_has_exactly_none_or_all_outside():
    rng = np.random.default_rng(1)
    x, yaw = rng.uniform(5, 35, 50), rng.uniform(-4, 4, 50)
    boxes = np.column_stack([x, np.zeros((50, 2)), np.full((50, 3), [4.3, 1.7, 1.5]), yaw])
    assert (truncation(boxes, X, Y) == 0).all()
    assert (truncation(boxes - [100, 0, 0, 0, 0, 0, 0], X, Y) == 1).all()
