"""Waymo v2: tables in the public layout, boxes and poses by hand and by SciPy, errors by row."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS
from lidarplace.scenes.datasets.waymo import read_waymo
from tests.lidarplace.waymo_layout import Box, Segment, write_waymo

AHEAD = 1.5
START = 1_550_083_467_346_370
HERE = np.eye(4)


def test_boxes_and_poses_by_hand(tmp_path):
    turned = np.eye(4)  # the vehicle looks along y of the world, at (10, 20)
    turned[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    turned[:3, 3] = 10.0, 20.0, 5.0
    boxes = [
        Box(START + 100_000, 4, (12.0, -2.0, 0.9), (1.8, 0.7, 1.7), 0.3, "rider"),
        Box(START, 1, (20.0, 3.0, 0.8), heading=-3.0, name="car"),
        Box(START, 3, (5.0, 3.0, 2.8), name="sign"),
    ]
    poses = {START + 100_000: turned, START: HERE, START + 200_000: HERE}
    ignored = Counter()
    folder = write_waymo(tmp_path, [Segment("training", "s1", poses, boxes)])
    log = read_waymo(folder, ignored=ignored)
    assert ignored == {"TYPE_SIGN": 1}
    assert log.frames["timestamp_s"].tolist() == [0.0, 0.1, 0.2], "in order, an empty one too"
    assert log.frames["source"].tolist() == [f"s1/{START + n * 100_000}" for n in range(3)]
    ego = [[AHEAD, 0, 0], [10.0, 20.0 + AHEAD, math.pi / 2], [AHEAD, 0, 0]]
    np.testing.assert_allclose(log.frames[list(POSE_COLUMNS)], ego, atol=1e-12)
    assert log.boxes["object_id"].tolist() == ["car", "rider"]
    assert log.boxes["class"].tolist() == ["Car", "Cyclist"]
    expected = [[18.5, 3.0, 0.8, 4.5, 1.9, 1.6, -3.0], [10.5, -2.0, 0.9, 1.8, 0.7, 1.7, 0.3]]
    np.testing.assert_allclose(log.boxes[list(GEOMETRY)], expected, atol=1e-12)


def test_segments_and_splits(tmp_path):
    segments = [
        Segment("validation", "a", {5: HERE}, [Box(5, 2, (3.0, 0.0, 1.0), (0.6, 0.6, 1.8))]),
        Segment("training", "c", {5: HERE, 6: HERE}),
        Segment("training", "b", {7: HERE}, [Box(7, 1, (9.0, 0.0, 1.0))]),
    ]
    log = read_waymo(write_waymo(tmp_path, segments))
    assert log.frames["scene"].tolist() == ["b", "c", "c", "a"]
    assert log.frames["route"].tolist() == [0, 1, 1, 2]
    assert log.frames["split"].tolist() == ["train", "train", "train", "test"]
    assert log.frames["frame"].tolist() == [0, 1, 2, 3]
    assert log.boxes["frame"].tolist() == [0, 3]
    only = read_waymo(tmp_path, splits=["validation"], class_map={"TYPE_PEDESTRIAN": "ignore"})
    assert (len(only.frames), len(only.boxes)) == (1, 0)


def test_counts_and_the_rig_come_along(tmp_path):
    extrinsic = np.eye(4)
    extrinsic[:3, :3] = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    extrinsic[:3, 3] = 1.43, 0.0, 2.18
    lidars = {1: (extrinsic, np.linspace(-0.3, 0.04, 64)), 4: (np.eye(4), [-1.5, 0.5])}
    segments = [
        Segment("training", name, {START: HERE}, [Box(START, 1, (20.0, 3.0, 0.8))], own)
        for name, own in (("s1", lidars), ("s2", {}))
    ]
    log = read_waymo(write_waymo(tmp_path, segments))
    assert log.boxes["points"].tolist() == [7, 7]
    assert log.boxes["points/TOP"].tolist() == [4, 4]
    assert list(log.rigs) == ["s1"], "the other has no calibration"
    assert log.rigs["s1"].names == ("TOP", "SIDE_RIGHT")
    top, _ = log.rigs["s1"].placement.mounts
    np.testing.assert_allclose(top.position, [1.43 - AHEAD, 0, 2.18], atol=1e-12)
    assert math.degrees(top.yaw) == pytest.approx(30)
    models = log.rigs["s1"].placement.lidars
    assert [(m.beams, m.azimuth_steps) for m in models] == [(64, 2650), (200, 600)]
    assert models[0].elevations == pytest.approx(np.linspace(-0.3, 0.04, 64))
    assert (min(models[1].elevations), max(models[1].elevations)) == pytest.approx((-1.495, 0.495))
