"""Objects of other frames in a frame: which, where, and with whose points."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.points_in_boxes import count_points
from tests.training.synthetic_scenes import BOX_COLUMNS, EMPTY, packed, scenes
from training.dataset import TrainingFrames
from training.ground_truth_sampling import ObjectDatabase
from training.ops.rotated_iou import iou_bev

CLASSES = ("Pedestrian", "Car")
GROUPS = {"Car": 6, "Pedestrian": 4, "Cyclist": 9}


def rows_of(array):
    return set(map(tuple, array.tolist()))


@pytest.fixture(scope="module")
def frames():
    clouds, truth = scenes(12, seed=1, classes=CLASSES, objects=8)
    return TrainingFrames(CLASSES, clouds, truth, sensor_height=1.73, min_points=0)


@pytest.fixture(scope="module")
def database(frames):
    return ObjectDatabase.of(frames, CLASSES, GROUPS, min_points=5)


def test_the_database_holds_every_object_with_its_points(frames, database):
    position = 0
    for index in range(len(frames)):
        sample = frames[index]
        counts = count_points(sample.points, sample.boxes)
        for box, label, count in zip(sample.boxes, sample.labels, counts, strict=True):
            if count < 5:
                continue
            assert np.array_equal(database.boxes[position], box)
            assert database.labels[position] == label
            object_points = database.points[
                database.offsets[position] : database.offsets[position + 1]
            ]
            grown = box + np.array([0, 0, 0, 1e-4, 1e-4, 1e-4, 0])
            assert count_points(object_points, grown[None]) == len(object_points)
            assert abs(len(object_points) - count) <= 1  # float32 at a face
            assert rows_of(object_points) <= rows_of(sample.points)
            position += 1
    assert position == len(database.boxes) == len(database.offsets) - 1
    assert {1, 2} == set(database.labels.tolist())


def test_a_class_without_a_group_is_not_gathered(frames):
    only = ObjectDatabase.of(frames, CLASSES, {"Car": 3, "Pedestrian": 0}, min_points=5)
    assert set(only.labels.tolist()) == {2}
    none = ObjectDatabase.of(frames, CLASSES, {}, min_points=5)
    assert len(none.boxes) == 0
    sample = frames[0]
    assert none.paste(sample, np.random.default_rng(0)) is sample


def test_pasted_objects_touch_nothing_and_bring_their_points(frames, database):
    random = np.random.default_rng(0)
    pasted = 0
    for index in range(len(frames)):
        old = frames[index]
        new = database.paste(frames[index], random)
        count = len(old.boxes)
        assert np.array_equal(new.boxes[:count], old.boxes)
        assert np.array_equal(new.labels[:count], old.labels)
        for label, wanted in ((1, 4), (2, 6)):
            present = (old.labels == label).sum()
            assert (new.labels == label).sum() <= max(wanted, present)
        added = new.boxes[count:]
        pasted += len(added)
        between = iou_bev(added, new.boxes)
        between[np.arange(len(added)), count + np.arange(len(added))] = 0
        assert (between == 0).all()
        rows = {tuple(box): k for k, box in enumerate(database.boxes.tolist())}
        objects = [rows[tuple(box)] for box in added.tolist()]
        object_points = (
            database.points[database.offsets[k] : database.offsets[k + 1]] for k in objects
        )
        points = np.concatenate([EMPTY.points, *object_points])
        assert np.array_equal(new.points[: len(points)], points)
        # Of the frame all points outside the new boxes, in their order.
        inside = np.zeros(len(old.points), bool)
        for box in added:
            inside |= [count_points(point[None], box[None])[0] > 0 for point in old.points]
        np.testing.assert_allclose(len(new.points) - len(points), (~inside).sum(), atol=2)
        assert len(rows_of(old.points[~inside]) - rows_of(new.points[len(points) :])) <= 2
    assert pasted > 20


def test_an_object_is_not_pasted_onto_itself():
    """A single object is pasted into other frames, not into its own."""
    box = (10.0, 0.0, 0.8, 4.0, 2.0, 1.6, 0.2)
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(-0.5, 0.5, (30, 3)) + box[:3], np.ones(30)])
    ground = np.column_stack([random.uniform((0, -20), (40, 20), (500, 2)), np.zeros((500, 2))])
    clouds = packed([3, 4], [np.concatenate([points, ground]), ground])
    truth = pd.DataFrame([(3, "Car", *box)], columns=BOX_COLUMNS)
    frames = TrainingFrames(["Car"], clouds, truth, 0.0, min_points=5)
    database = ObjectDatabase.of(frames, ["Car"], {"Car": 20}, min_points=5)
    assert len(database.boxes) == 1
    assert len(database.paste(frames[0], random).boxes) == 1
    other = database.paste(frames[1], random)
    np.testing.assert_allclose(other.boxes, [box], atol=1e-6)
    assert other.labels.tolist() == [1]
    under = count_points(ground, [box])[0]
    assert len(other.points) == len(database.points) + 500 - under
    # Two that overlap each other are both left out.
    boxes = np.concatenate([database.boxes, database.boxes + np.float32(0.1)])
    points, ends = np.tile(database.points, (2, 1)), np.arange(3) * len(database.points)
    twice = ObjectDatabase(points, ends, boxes, np.array([1, 1]), np.array([0, 1]), 2, {1: 20})
    assert len(twice.paste(frames[1], random).boxes) == 0


def test_rigs_that_see_other_objects_paste_the_same_where_they_can():
    clouds, truth = scenes(20, seed=2, objects=8)
    thinned = packed(clouds.frames, (clouds[k][::12] for k in range(len(clouds))))
    frames = (TrainingFrames(["Car"], rig, truth, 0.0, 5) for rig in (clouds, thinned))
    dense, sparse = (ObjectDatabase.of(frame, ["Car"], {"Car": 10}, 5) for frame in frames)
    assert 20 < len(sparse.boxes) < 0.8 * len(dense.boxes)
    sparse_rows = rows_of(sparse.boxes)
    for seed in range(20):
        many, few = (
            rows_of(database.paste(EMPTY, np.random.default_rng(seed)).boxes)
            for database in (dense, sparse)
        )
        # Objects that both have are pasted by both, but for those that touch one of another's.
        shared = many & sparse_rows
        assert len(shared & few) >= len(shared) - 3


def test_objects_are_drawn_evenly_and_by_the_seed(frames, database):
    first, again, other = (
        database.paste(EMPTY, np.random.default_rng(seed)).boxes for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    random = np.random.default_rng(0)
    seen = set().union(*(rows_of(database.paste(EMPTY, random).boxes) for _ in range(200)))
    assert seen == rows_of(database.boxes)
