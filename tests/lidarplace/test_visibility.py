"""What counts as ground truth: hidden and outside objects do not."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace import Roi
from lidarplace.clouds.visibility import ground_truth, occluded, visibility
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from tests.lidarplace.recall.small_scenes import log_of

FRONT = Roi((0, 40), (-20, 20), (0, 4), resolution=0.5)


def table(*rows: tuple[int, float, float, float, float, float]) -> BoxLog:
    """Rows of frame, x, y, length, width, height, yaw 0, of a class that fills its box."""
    return log_of(*((frame, "Tram", *rest, 0.0) for frame, *rest in rows))


TRUCK = (0, 10.0, 0.0, 7.0, 2.5, 3.4)
HIDDEN_CAR = (0, 20.0, 0.0, 4.5, 1.8, 1.5)
FREE_CAR = (0, 20.0, 12.0, 4.5, 1.8, 1.5)


def test_hidden_partly_hidden_and_free():
    half = (0, 20.0, 3.5, 4.5, 1.8, 1.5)
    share = visibility(table(HIDDEN_CAR, FREE_CAR, half, TRUCK))
    assert share[0] == 0
    assert share[1] == share[3] == 1
    assert 0.05 < share[2] < 0.95


def test_frames_do_not_hide_each_other_and_rows_keep_their_place():
    rows = [TRUCK, (1, *HIDDEN_CAR[1:]), HIDDEN_CAR, (1, *FREE_CAR[1:]), FREE_CAR]
    np.testing.assert_array_equal(visibility(table(*rows)), [1, 1, 0, 1, 1])


def test_a_car_before_a_taller_box_hides_only_its_lower_part():
    low, tall = (0, 10.0, 0.0, 4.5, 6.0, 1.2), (0, 20.0, 0.0, 1.0, 2.0, 3.4)
    share = visibility(table(low, tall))
    # Where the ray from 2.4 m over the far edge of the low box's top meets the tall one's face.
    shadow = 2.4 - (2.4 - 1.2) * 19.5 / 12.25
    assert share[0] == 1
    assert share[1] == pytest.approx(1 - shadow / 3.4, abs=0.05)


def test_ground_truth_is_visible_and_in_the_roi():
    behind, at_the_edge = (0, -10.0, 0.0, 4.5, 1.8, 1.5), (0, 1.0, -12.0, 4.0, 2.0, 1.5)
    log = table(HIDDEN_CAR, FREE_CAR, behind, TRUCK, at_the_edge)
    truth = ground_truth(log, FRONT.x, FRONT.y, FRONT.z)
    assert truth.index.tolist() == [1, 3, 4]
    np.testing.assert_array_equal(truth["visibility"], [1, 1, 1])
    np.testing.assert_array_equal(truth["occluded"], [0, 0, 0])
    np.testing.assert_allclose(truth["truncated"], [0, 0, 0.25])
    assert "visibility" not in log.boxes.columns
    counted = replace(log, boxes=log.boxes.assign(points=7.0, **{"points/top": 7.0}))
    pd.testing.assert_frame_equal(ground_truth(counted, FRONT.x, FRONT.y, FRONT.z), truth)


def test_levels_of_occlusion():
    share = np.array([1.0, 0.8, 0.79, 0.4, 0.39, 1e-3, 0.0])
    np.testing.assert_array_equal(occluded(share), [0, 0, 1, 1, 2, 2, 3])


def test_a_building_hides():
    log = table(HIDDEN_CAR, FREE_CAR)
    frames = log.frames.assign(ego_x=5.0, ego_y=-3.0, ego_yaw=math.pi / 2)
    # In the world the car is 20 m along y from the vehicle; the wall stands half way.
    wall = pd.DataFrame([("a", 5.0, 7.0, 5.0, 6.0, 0.5, 10.0, 0.0)], columns=["scene", *GEOMETRY])
    np.testing.assert_array_equal(visibility(BoxLog(log.boxes, frames, wall)), [0, 1])
    elsewhere = wall.assign(scene="b")
    np.testing.assert_array_equal(visibility(BoxLog(log.boxes, frames, elsewhere)), [1, 1])
    around = wall.assign(y=-3.0, length=9.0, width=9.0)
    np.testing.assert_array_equal(visibility(BoxLog(log.boxes, frames, around)), [1, 1])


def test_one_sees_past_the_cabin_of_a_car_but_not_past_a_brick():
    before, behind = (0, 8.0, 0.0, 4.5, 1.8, 1.9), (0, 14.0, 0.0, 0.5, 1.7, 1.7)
    bricks = visibility(table(before, behind))
    log = table(before, behind)
    shapes = visibility(BoxLog(log.boxes.assign(**{"class": ["Car", "Tram"]}), log.frames))
    assert bricks[0] == shapes[0] == 1
    assert shapes[1] > bricks[1] + 0.05


def test_an_object_outside_the_roi_still_hides():
    truck_in_the_way = (0, 35.0, 26.0, 2.5, 30.0, 3.4)
    far = Roi((36, 60), (25, 40), (0, 4), resolution=0.5)
    car = (0, 45.0, 33.0, 4.5, 1.8, 1.5)
    assert len(ground_truth(table(car), far.x, far.y, far.z)) == 1
    assert len(ground_truth(table(car, truck_in_the_way), far.x, far.y, far.z)) == 0


def test_zero_size_and_enclosing_boxes_count_as_unseen():
    enclosing = (0, 0.0, 0.0, 5.0, 5.0, 5.0)
    point = (0, 10.0, 5.0, 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(visibility(table(enclosing, point, FREE_CAR)), [0, 0, 1])


def test_no_rows():
    log = table(FREE_CAR)
    empty = BoxLog(log.boxes[:0], log.frames)
    assert visibility(empty).shape == (0,)
    truth = ground_truth(empty, FRONT.x, FRONT.y, FRONT.z)
    assert truth.columns.tolist()[-3:] == ["visibility", "occluded", "truncated"]
