"""Points counted in boxes, against rotations written out."""

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import PointClouds
from lidarplace.clouds.points_in_boxes import (
    BY_DISTANCE,
    MARGIN_M,
    box_of_points,
    count_points,
    count_points_per_object,
    points_by_distance,
)
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.pose import rotation


def test_points_in_boxes_agree_with_rotated_points():
    rng = np.random.default_rng(0)
    points = rng.uniform(-10, 10, (5000, 4)).astype(np.float32)
    boxes = np.column_stack(
        [rng.uniform(-8, 8, (30, 3)), rng.uniform(0.5, 9, (30, 3)), rng.uniform(-4, 4, 30)]
    )
    counts, last = [], np.full(len(points), -1)
    for number, box in enumerate(boxes):
        off = np.abs((points[:, :3] - box[:3]) @ rotation(0, 0, box[6]))
        counts.append((off <= box[3:6] / 2).all(axis=1).sum())
        last[(off <= box[3:6] / 2 + MARGIN_M).all(axis=1)] = number
    np.testing.assert_array_equal(count_points(points, boxes), counts)
    np.testing.assert_array_equal(box_of_points(points, boxes), last)
    assert min(counts) < 10 < max(counts)
    assert len(np.unique(last)) > 15


def test_a_point_on_the_surface_is_inside():
    box = np.array([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, 0.0]])
    corner = np.array([[3.0, 3.0, 3.5, 0.0]], np.float32)
    for axis in range(3):
        beyond = corner.copy()
        beyond[0, axis] = np.nextafter(corner[0, axis], np.float32(np.inf))
        assert count_points(np.concatenate([corner, beyond]), box).tolist() == [1]


def test_points_per_object_of_the_frames_that_were_collected():
    box = [10.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0]
    far = [30.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0]
    boxes = pd.DataFrame([box, far, box, box], columns=list(GEOMETRY))
    boxes = boxes.assign(frame=[7, 3, 3, 5], object_id=["a", "b", "a", "a"])
    on_the_skin = np.array([[8.0 - MARGIN_M / 2, 0, 1, 0.5], [8.0 - 2 * MARGIN_M, 0, 1, 0.5]])
    inside = np.array([[10.0, 0.5, 0.5, 0.1]] * 3)
    packed = [(points.astype(np.float32), [len(points)]) for points in (on_the_skin, inside)]
    clouds = PointClouds.from_frames([3, 7], packed, (0.0, -5.0, 0.0, 40.0, 5.0, 4.0))
    table = count_points_per_object(boxes, clouds)
    assert table.to_dict("list") == {
        "frame": [7, 3, 3],
        "object_id": ["a", "b", "a"],
        "points": [3, 0, 1],
    }
    assert count_points_per_object(boxes[:0], clouds).columns.tolist() == table.columns.tolist()


def test_points_by_distance_against_a_loop():
    rng = np.random.default_rng(0)
    ids = {"frame": np.repeat(np.arange(30), 10), "object_id": np.tile(np.arange(10), 30)}
    objects = pd.DataFrame(ids)
    objects = objects.assign(x=rng.uniform(-70, 70, 300), y=rng.uniform(-20, 20, 300))
    objects["class"] = rng.choice(["Car", "Cyclist"], 300)
    points = objects[["frame", "object_id"]].assign(points=rng.poisson(3, 300))
    points = points[points["frame"] < 25].sample(frac=1, random_state=1)
    table = points_by_distance(objects, points)
    count = {(r.frame, r.object_id): r.points for r in points.itertuples()}
    for row in table.itertuples():
        own = [
            count[r.frame, r.object_id]
            for r in objects[objects["frame"] < 25].itertuples()
            if r._5 == table.loc[row.Index, "class"] and row.from_m <= np.hypot(r.x, r.y) < row.to_m
        ]
        assert row.objects == len(own)
        assert row.mean == np.mean(own)
        assert row.median == np.median(own)
        assert row.p10 == np.quantile(own, 0.1)
        assert row.unseen == np.mean(np.array(own) == 0)
    assert table["objects"].sum() == 250
    none = points_by_distance(objects, points[:0])
    assert none.empty
    assert tuple(none.columns) == BY_DISTANCE
