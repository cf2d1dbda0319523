"""The vehicle's body: its boxes, its height, and what is within it."""

import math

import numpy as np
import pytest

from lidarplace.mounting.vehicle import Vehicle, depth_in_body

CAR = Vehicle.car()


@pytest.mark.parametrize(
    ("place", "inside"),
    [
        ((2.0, 0.9, 0.5), True),  # hull
        ((0.0, 0.0, 1.4), True),  # cabin
        ((0.0, 0.0, 0.95), True),  # where the hull ends within the cabin
        ((2.0, 0.0, 1.2), False),  # above the bonnet
        *((at, False) for at in ((0, 0, 1.6), (0, 0, 1.5), (2.35, 0, 0.5), (0, -0.95, 0.2))),
        ((0, 0, 0), False),
        ((0, 0, math.nextafter(1.5, 0)), False),  # rounding of a height
        ((0, 0, 1.5 - 1e-6), True),
    ],
)
def test_the_car(place, inside):
    assert (depth_in_body(CAR, np.array([place], np.float64))[0] > 0) == inside
    size = CAR.boxes[:, 1].max(axis=0) - CAR.boxes[:, 0].min(axis=0)
    np.testing.assert_allclose(size, [4.7, 1.9, 1.5])
    assert CAR.height == 1.5


@pytest.mark.parametrize(
    ("boxes", "height"), [(np.array([]), 0), (np.array([[[-1, -1, 1], [1, 1, 1]]]), 1)]
)
def test_no_box_and_one_without_volume_hold_nothing(boxes, height):
    vehicle = Vehicle("nothing", boxes)
    assert vehicle.boxes.shape == (height, 2, 3)
    assert vehicle.height == height
    assert len(vehicle.interior) == 0
    assert depth_in_body(vehicle, np.array([[0.0, 0, 0], [0, 0, 1]])).max() == 0


def test_later_changes_of_the_array_do_not_reach_the_vehicle():
    boxes = np.array([[[0.0, 0, 0], [1, 1, 1]]])
    vehicle = Vehicle("cube", boxes)
    boxes[:] = 7
    assert vehicle.height == 1
