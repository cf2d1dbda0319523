"""The vehicle's body: its boxes, its height, and what is within it."""

import math

import numpy as np

from lidarplace.mounting.vehicle import Vehicle, depth_in_body


def inside(vehicle, point):
    return bool(depth_in_body(vehicle, np.array([point], np.float64))[0] > 0)


def test_the_car():
    car = Vehicle.car()
    size = car.boxes[:, 1].max(axis=0) - car.boxes[:, 0].min(axis=0)
    np.testing.assert_allclose(size, [4.7, 1.9, 1.5])
    assert car.height == 1.5
    assert inside(car, (2.0, 0.9, 0.5))  # hull
    assert inside(car, (0.0, 0.0, 1.4))  # cabin
    assert inside(car, (0.0, 0.0, 0.95))  # where the hull ends within the cabin
    assert not inside(car, (2.0, 0.0, 1.2))  # above the bonnet
    assert not inside(car, (0.0, 0.0, 1.6))


def test_the_surface_is_outside():
    car = Vehicle.car()
    for point in [(0, 0, 1.5), (2.35, 0, 0.5), (0, -0.95, 0.2), (0, 0, 0)]:
        assert not inside(car, point)
    assert not inside(car, (0, 0, math.nextafter(1.5, 0)))  # rounding of a height
    assert inside(car, (0, 0, 1.5 - 1e-6))


def test_without_boxes():
    nothing = Vehicle("nothing", np.empty((0, 2, 3)))
    assert Vehicle("nothing", np.array([])).boxes.shape == nothing.boxes.shape == (0, 2, 3)
    assert nothing.height == 0
    assert not inside(nothing, (0, 0, 0))


def test_a_box_without_volume_holds_nothing():
    plate = Vehicle("plate", np.array([[[-1, -1, 1], [1, 1, 1]]]))
    assert plate.height == 1
    assert len(plate.interior) == 0
    assert not inside(plate, (0, 0, 1))


def test_later_changes_of_the_array_do_not_reach_the_vehicle():
    boxes = np.array([[[0.0, 0, 0], [1, 1, 1]]])
    vehicle = Vehicle("cube", boxes)
    boxes[:] = 7
    assert vehicle.height == 1
