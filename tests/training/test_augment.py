"""Random changes to training frames: points stay with their boxes, and the seed decides."""

import math

import numpy as np

from lidarplace.clouds.points_in_boxes import count_points
from tests.training.synthetic_scenes import EMPTY, PLAIN, scenes
from training.augment import Augmentation, moved, within_range
from training.dataset import Sample, TrainingFrames
from training.ground_truth_sampling import ObjectDatabase
from training.settings import TrainingSettings

RANGE = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)


def frames_of(count, seed):
    return TrainingFrames(["Car"], *scenes(count, seed, objects=9, fewest=7), 0.0, min_points=5)


def augmentation(frames, settings):
    database = ObjectDatabase.of(frames, ["Car"], settings.sample_groups, settings.min_points)
    return Augmentation(settings, RANGE, database)


def test_points_move_with_their_boxes_and_the_frames_are_left_alone():
    frames = frames_of(6, 4)
    before = frames[5]
    random = np.random.default_rng(0)
    mirrored = 0
    for index in range(6):
        old = frames[index]
        inside = count_points(old.points, old.boxes * [1, 1, 1, 1.05, 1.05, 1.05, 1])
        new = moved(frames[index], TrainingSettings(), random)
        after = count_points(new.points, new.boxes * [1, 1, 1, 1.05, 1.05, 1.05, 1])
        np.testing.assert_allclose(after, inside, atol=2)  # float32 at the faces
        assert not np.allclose(new.boxes[:, :2], old.boxes[:, :2])
        ratio = new.boxes[:, 3:6] / old.boxes[:, 3:6]
        assert ((ratio > 0.949) & (ratio < 1.051)).all()
        # All boxes turn by the same angle, which tells a mirrored frame from another.
        turned, flipped = (
            np.ptp(np.unwrap(np.sort((new.boxes[:, 6] + sign * old.boxes[:, 6]) % (2 * math.pi))))
            for sign in (-1, 1)
        )
        assert min(turned, flipped) < 1e-4 < max(turned, flipped)
        mirrored += flipped < turned
        assert (np.abs(new.boxes[:, 6]) <= math.pi + 1e-6).all()
    assert 0 < mirrored < 6
    assert np.array_equal(frames[5].points, before.points)
    assert np.array_equal(frames[5].boxes, before.boxes)
    plain = moved(frames[0], PLAIN, random)
    assert np.array_equal(plain.boxes, frames[0].boxes)
    assert np.array_equal(plain.points, frames[0].points)


def test_what_leaves_the_range_is_dropped():
    points = np.array([[1, 0, 9, 0], [-1, 0, 1, 0], [1, 21, 1, 0]], np.float32)
    boxes = np.array([[1, 0, 9, 1, 1, 1, 0], [41, 0, 1, 1, 1, 1, 0]], np.float32)
    inside = within_range(Sample(points, boxes, np.array([1, 2])), RANGE)
    assert inside.points.tolist() == [[1, 0, 9, 0]]  # seen from above: height does not matter
    assert inside.labels.tolist() == [1]
    assert inside.boxes.shape == (1, 7)


def test_points_are_shuffled_by_the_seed_and_none_is_lost():
    frames = frames_of(2, 5)
    augment = augmentation(frames, PLAIN)
    first, again, other = (augment(frames[0], (seed, 1, 0)).points for seed in (1, 1, 2))
    inside = within_range(frames[0], RANGE).points
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first, inside)
    for points in (first, other):
        assert np.array_equal(np.unique(points, axis=0), np.unique(inside, axis=0))
        assert len(points) == len(inside)


def test_the_whole_augmentation_follows_from_the_seed():
    frames = frames_of(6, 6)
    augment = augmentation(frames, TrainingSettings())
    one, two, *others = (
        augment(frames[0], key) for key in ((3, 1, 0), (3, 1, 0), (4, 1, 0), (3, 2, 0), (3, 1, 1))
    )
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.boxes, two.boxes)
    for other in others:
        assert not np.array_equal(one.boxes, other.boxes)


def test_a_setting_changes_nothing_else():
    """Frames that are not mirrored are turned and scaled as those that are."""
    frames = frames_of(6, 6)
    settings = TrainingSettings(sample_groups={})
    for k in range(6):
        boxes = (
            moved(frames[k], varied, np.random.default_rng(k)).boxes[:, :2]
            for varied in (settings, settings.model_copy(update={"flip_y": False}))
        )
        one, other = (np.linalg.norm(varied, axis=1) for varied in boxes)
        np.testing.assert_allclose(one, other, rtol=1e-5)


def test_an_empty_frame_stays_a_frame():
    filled = augmentation(frames_of(2, 5), PLAIN)(EMPTY, (0, 1, 0))
    assert (filled.points.shape, filled.boxes.shape, filled.labels.shape) == ((0, 4), (0, 7), (0,))
