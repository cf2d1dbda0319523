"""What counts as ground truth: hidden and outside objects do not."""

import numpy as np
import pandas as pd
import pytest

from lidarplace import Roi
from lidarplace.boxes import GEOMETRY
from lidarplace.lidar.visibility import ground_truth, visibility

FRONT = Roi((0, 40), (-20, 20), (0, 4), resolution=0.5)


def table(*rows: tuple[int, float, float, float, float, float]) -> pd.DataFrame:
    """Rows of frame, x, y, length, width, height; boxes stand on the ground with yaw 0."""
    frame, x, y, length, width, height = (np.array(column) for column in zip(*rows, strict=True))
    data = [x, y, height / 2, length, width, height, np.zeros(len(rows))]
    boxes = pd.DataFrame(dict(zip(GEOMETRY, data, strict=True)))
    return boxes.assign(frame=frame.astype(int), **{"class": "Car"})


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


def test_frames_of_two_scenes_are_told_apart():
    boxes = table(TRUCK, HIDDEN_CAR).assign(scene=["a", "b"])
    np.testing.assert_array_equal(visibility(boxes), [1, 1])


def test_a_car_before_a_taller_box_hides_only_its_lower_part():
    low, tall = (0, 10.0, 0.0, 4.5, 6.0, 1.2), (0, 20.0, 0.0, 1.0, 2.0, 3.4)
    share = visibility(table(low, tall))
    # Where the ray from 2.4 m over the far edge of the low box's top meets the tall one's face.
    shadow = 2.4 - (2.4 - 1.2) * 19.5 / 12.25
    assert share[0] == 1
    assert share[1] == pytest.approx(1 - shadow / 3.4, abs=0.05)


def test_ground_truth_is_visible_and_in_the_roi():
    behind = (0, -10.0, 0.0, 4.5, 1.8, 1.5)
    boxes = table(HIDDEN_CAR, FREE_CAR, behind, TRUCK)
    truth = ground_truth(boxes, FRONT.x, FRONT.y, FRONT.z)
    assert truth.index.tolist() == [1, 3]
    np.testing.assert_array_equal(truth["visibility"], [1, 1])
    assert "visibility" not in boxes.columns


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
    empty = table(FREE_CAR)[:0]
    assert visibility(empty).shape == (0,)
    assert ground_truth(empty, FRONT.x, FRONT.y, FRONT.z).columns[-1] == "visibility"
