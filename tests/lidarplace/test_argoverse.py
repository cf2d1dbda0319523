"""Argoverse 2: files in the public layout, poses by hand and by SciPy box by box, errors by row."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lidarplace.logs.boxes import BOX_COLUMNS, CLASSES, POSE_COLUMNS, check_boxes
from lidarplace.scenes.datasets.argoverse import read_argoverse
from lidarplace.scenes.datasets.class_maps import ARGOVERSE, IGNORE
from tests.lidarplace.argoverse_layout import LEVEL, Box, Log, write_argoverse

AHEAD, HEIGHT = 1.425, 0.33  # half the wheelbase of a Ford Fusion; its rear axle above the ground
START = 315_968_867_659_956_000
TENTH = 100_000_000
HERE = {START + n * TENTH: (LEVEL, (0.0, 0.0, 0.0)) for n in range(4)}


def car(time=START, **values):
    return Box(time, "REGULAR_VEHICLE", (10.0, 1.0, 0.5), **values)


def test_a_car_ahead_of_a_vehicle_that_drives_north_uphill(tmp_path):
    # The road climbs by 30 degrees to the north: ahead is (0, cos, sin) and up is (0, -sin, cos).
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    ahead, left, up = np.array([(0, cos, sin), (-1, 0, 0), (0, -sin, cos)])
    x, y, z, w = Rotation.from_matrix(np.stack([ahead, left, up], axis=1)).as_quat()
    box = car(size=(4.6, 1.9, 1.7), rotation=(math.cos(0.2), 0, 0, math.sin(0.2)))
    pose = {START: ((w, x, y, z), (700.0, -100.0, -19.0))}
    log = read_argoverse(write_argoverse(tmp_path, [Log("train", "01bb", [box], pose)]))
    row = log.boxes.iloc[0]
    found = row[["x", "y", "z", "length", "width", "height", "yaw"]].to_numpy(float)
    expected = (10 - AHEAD, 1.0, 0.5 + HEIGHT, 4.6, 1.9, 1.7, 0.4)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert (row["scene"], row["class"], row["object_id"]) == ("01bb", "Car", "022c398c")
    place = (700.0, -100.0 + AHEAD * cos + HEIGHT * sin, math.pi / 2)
    pose = log.frames[list(POSE_COLUMNS)].iloc[0].to_numpy(float)
    np.testing.assert_allclose(pose, place, atol=1e-12)


def test_poses_agree_with_scipy_box_by_box(tmp_path):
    rng = np.random.default_rng(5)
    times = [START + n * TENTH for n in range(30)]
    poses = {
        time: (tuple(Rotation.random(rng=rng).as_quat()), tuple(rng.uniform(-900, 900, 3)))
        for time in rng.permutation(times).tolist()
    }
    boxes = []
    for time in rng.choice(times, 100).tolist():
        own = rng.uniform(-80, 80, 3), rng.uniform(0.3, 2, 3), Rotation.random(rng=rng).as_quat()
        boxes.append(Box(time, "PEDESTRIAN", *map(tuple, own)))
    log = read_argoverse(write_argoverse(tmp_path, [Log("val", "a", boxes, poses, times)]))
    boxes.sort(key=lambda box: box.timestamp_ns)
    for row, box in zip(log.boxes.to_dict("records"), boxes, strict=True):
        assert times[row["frame"]] == box.timestamp_ns
        w, x, y, z = box.rotation
        nose = Rotation.from_quat([x, y, z, w]).apply([box.size[0] / 2, 0, 0])
        place = row["x"] + AHEAD, row["y"], row["z"] - HEIGHT
        np.testing.assert_allclose(place, box.translation, atol=1e-12)
        assert math.isclose(row["yaw"], math.atan2(nose[1], nose[0]), abs_tol=1e-12)
    for row, time in zip(log.frames.to_dict("records"), times, strict=True):
        (w, x, y, z), place = poses[time]
        city = Rotation.from_quat([x, y, z, w])
        nose, origin = city.apply([1, 0, 0]), city.apply([AHEAD, 0, -HEIGHT]) + place
        np.testing.assert_allclose((row["ego_x"], row["ego_y"]), origin[:2], atol=1e-9)
        assert math.isclose(row["ego_yaw"], math.atan2(nose[1], nose[0]), abs_tol=1e-12)


def test_logs_splits_and_empty_sweeps(tmp_path):
    times = sorted(HERE)
    logs = [
        Log("val", "b", [car(times[2]), car(times[0], track="other")], HERE, times[1:3]),
        Log("train", "d", [car(times[3]), car(times[1])], HERE),
        Log("train", "c", [], HERE, times[:2]),
    ]
    folder = write_argoverse(tmp_path / "sensor", logs)
    log = read_argoverse(folder)
    assert list(log.boxes.columns) == [*BOX_COLUMNS, "points"]
    assert {"route", *POSE_COLUMNS, "ego_z", "ego_roll"} < set(log.frames.columns)
    check_boxes(log.boxes)
    frames = log.frames
    assert frames["frame"].tolist() == list(range(7))
    assert frames["scene"].tolist() == list("ccddbbb")
    assert frames["route"].tolist() == [0, 0, 1, 1, 2, 2, 2]
    assert frames["split"].tolist() == ["train"] * 4 + ["test"] * 3
    # Log d has no sweeps, so its frames are those with boxes; log b lacks the sweep of one.
    np.testing.assert_allclose(frames["timestamp_s"], [0, 0.1, 0, 0.2, 0, 0.1, 0.2], atol=1e-12)
    assert log.boxes["frame"].tolist() == [2, 3, 4, 6]
    np.testing.assert_allclose(log.boxes["timestamp_s"], [0, 0.2, 0, 0.2], atol=1e-12)
    assert log.boxes["object_id"].tolist() == ["022c398c", "022c398c", "other", "022c398c"]
    assert set(read_argoverse(folder, splits=["val"]).frames["scene"]) == {"b"}


def test_classes(tmp_path):
    boxes = [Box(START, name, (9.0, 0.0, 1.0), track=name) for name in sorted(ARGOVERSE)]
    folder = write_argoverse(tmp_path, [Log("train", "a", boxes, HERE)])
    ignored = Counter()
    log = read_argoverse(folder, ignored=ignored)
    assert len(ARGOVERSE) == 32  # 30, the guide's other name for one of them, and EGO_VEHICLE
    assert log.boxes["class"].value_counts()[list(CLASSES)].tolist() == [1, 8, 2]
    assert ignored == {name: 1 for name, value in ARGOVERSE.items() if value == IGNORE}
    own = read_argoverse(folder, class_map={"BUS": "Cyclist", "TRUCK_CAB": IGNORE})
    assert "BUS" in own.boxes["object_id"].tolist()
    assert "TRUCK_CAB" not in own.boxes["object_id"].tolist()


MOUNTS = {
    "down_lidar": ((0.0, 1.0, 0.0, 0.0), (1.35, 0.0, 1.53)),  # upside down
    "ring_front_center": (LEVEL, (1.6, 0.0, 1.4)),
    "up_lidar": (LEVEL, (1.35, 0.0, 1.64)),
}


def test_counts_the_rig_and_full_poses_come_along(tmp_path):
    poses = {START: (Rotation.from_euler("y", 0.1).as_quat()[[3, 0, 1, 2]], (5.0, 0.0, 12.0))}
    folder = write_argoverse(tmp_path, [Log("val", "a", [car()], poses, mounts=MOUNTS)])
    log = read_argoverse(folder)
    assert log.boxes["points"].tolist() == [10]
    rig = log.rigs["a"]
    assert rig.names == ("up_lidar", "down_lidar")
    up, down = rig.placement.mounts
    np.testing.assert_allclose(up.position, [1.35 - AHEAD, 0, 1.64 + HEIGHT], atol=1e-12)
    assert abs(down.roll) == pytest.approx(math.pi)
    assert [lidar.beams for lidar in rig.placement.lidars] == [32, 32]
    pose = log.frames[["ego_z", "ego_roll", "ego_pitch"]].iloc[0].to_numpy(float)
    lower = 12 - AHEAD * math.sin(0.1) - HEIGHT * math.cos(0.1)
    np.testing.assert_allclose(pose, [lower, 0, 0.1], atol=1e-12)


def test_ignored_categories_may_be_kept_as_obstacles(tmp_path):
    boxes = [car(), Box(START, "BUS", (9.0, 0.0, 1.0)), Box(START, "EGO_VEHICLE", (0.0, 0.0, 0.0))]
    folder = write_argoverse(tmp_path, [Log("val", "a", boxes, HERE)])
    ignored = Counter()
    log = read_argoverse(folder, keep_ignored=True, ignored=ignored)
    assert log.boxes["class"].tolist() == ["Car", "Other"]
    assert ignored == {"EGO_VEHICLE": 1}
