"""Points counted in boxes, against rotations written out."""

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import PointClouds
from lidarplace.clouds.points_in_boxes import (
    MARGIN_M,
    box_of_points,
    count_points,
    count_points_per_object,
)
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.pose import rotation


def test_counts_agree_with_rotated_points():
    rng = np.random.default_rng(0)
    points = rng.uniform(-10, 10, (5000, 4)).astype(np.float32)
    boxes = np.column_stack(
        [rng.uniform(-8, 8, (30, 3)), rng.uniform(0.5, 9, (30, 3)), rng.uniform(-4, 4, 30)]
    )
    expected = [
        (np.abs((points[:, :3] - box[:3]) @ rotation(0, 0, box[6])) <= box[3:6] / 2)
        .all(axis=1)
        .sum()
        for box in boxes
    ]
    np.testing.assert_array_equal(count_points(points, boxes), expected)
    assert min(expected) < 10 < max(expected)


def test_a_point_on_the_surface_is_inside():
    box = np.array([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, 0.0]])
    corner = np.array([[3.0, 3.0, 3.5, 0.0]], np.float32)
    for axis in range(3):
        beyond = corner.copy()
        beyond[0, axis] = np.nextafter(corner[0, axis], np.float32(np.inf))
        assert count_points(np.concatenate([corner, beyond]), box).tolist() == [1]


def test_the_box_of_a_point_is_the_last_one_that_holds_it():
    rng = np.random.default_rng(1)
    points = rng.uniform(-10, 10, (2000, 4)).astype(np.float32)
    boxes = np.column_stack(
        [rng.uniform(-8, 8, (20, 3)), rng.uniform(0.5, 9, (20, 3)), rng.uniform(-4, 4, 20)]
    )
    expected = np.full(len(points), -1)
    for number, box in enumerate(boxes):
        off = np.abs((points[:, :3] - box[:3]) @ rotation(0, 0, box[6]))
        expected[(off <= box[3:6] / 2 + MARGIN_M).all(axis=1)] = number
    np.testing.assert_array_equal(box_of_points(points, boxes), expected)
    assert len(np.unique(expected)) > 15


def test_points_per_object_of_the_frames_that_were_collected():
    box = [10.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0]
    far = [30.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0]
    boxes = pd.DataFrame([box, far, box, box], columns=list(GEOMETRY))
    boxes = boxes.assign(frame=[7, 3, 3, 5], object_id=["a", "b", "a", "a"])
    on_the_skin = np.array([[8.0 - MARGIN_M / 2, 0, 1, 0.5], [8.0 - 2 * MARGIN_M, 0, 1, 0.5]])
    inside = np.array([[10.0, 0.5, 0.5, 0.1]] * 3)
    clouds = PointClouds.from_frames(
        [3, 7],
        [(points.astype(np.float32), [len(points)]) for points in (on_the_skin, inside)],
        (0.0, -5.0, 0.0, 40.0, 5.0, 4.0),
    )
    table = count_points_per_object(boxes, clouds)
    assert table.to_dict("list") == {
        "frame": [7, 3, 3],
        "object_id": ["a", "b", "a"],
        "points": [3, 0, 1],
    }
    assert count_points_per_object(boxes[:0], clouds).columns.tolist() == table.columns.tolist()
