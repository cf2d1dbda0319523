"""nuScenes: tables in the public layout, poses by hand and by matrices, errors that name a row."""

import json
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, CLASSES, POSE_COLUMNS, check_boxes
from lidarplace.rigs.lidar import Lidar
from lidarplace.scenes.datasets.class_maps import IGNORE, NUSCENES, named_class_map
from lidarplace.scenes.datasets.nuscenes import ORIGIN, ZOE, read_nuscenes
from tests.lidarplace import nuscenes_layout
from tests.lidarplace.nuscenes_layout import Box, Sample, Scene, write_nuscenes

AHEAD = 1.294  # half the wheelbase of a Renault Zoe
START = 1_532_402_927_647_951
CATEGORIES = ["vehicle.car", "human.pedestrian.adult", "movable_object.barrier", "flat.sidewalk"]


def turn(axis, angle):
    """Quaternion w, x, y, z of a turn about an axis."""
    return (math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis) / np.linalg.norm(axis)))


def rotation(quaternion):
    """SciPy's quaternions are x, y, z, w."""
    return Rotation.from_quat(np.roll(quaternion, -1))


def matrix(position, quaternion):
    """The 4 x 4 matrix of a pose."""
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = rotation(quaternion).as_matrix(), position
    return whole


def product(a, b):
    """Quaternion of a turn b, then a."""
    return np.roll((rotation(a) * rotation(b)).as_quat(), 1)


def test_a_car_ahead_of_a_vehicle_that_drives_north(tmp_path):
    north = turn((0, 0, 1), math.pi / 2)
    car = Box("vehicle.car", (99.0, 210.0, 0.9), (1.9, 4.6, 1.7), north)
    scene = Scene("scene-0061", [Sample(START, [car], (100.0, 200.0, 0.0), north)])
    log = read_nuscenes(write_nuscenes(tmp_path / "v1.0-mini", [scene], CATEGORIES))
    box, frame = log.boxes.iloc[0], log.frames.iloc[0]
    expected = (10 - AHEAD, 1.0, 0.9, 4.6, 1.9, 1.7, 0.0)
    found = box[["x", "y", "z", "length", "width", "height", "yaw"]]
    np.testing.assert_allclose(found.to_numpy(float), expected, atol=1e-12)
    assert (box["scene"], box["frame"], box["class"]) == ("scene-0061", 0, "Car")
    pose = frame[list(POSE_COLUMNS)].to_numpy(float)
    np.testing.assert_allclose(pose, (100, 200 + AHEAD, math.pi / 2), atol=1e-12)


def test_corners_agree_with_matrices(tmp_path):
    # Boxes stand upright in the tilted frame of the vehicle, so that their yaw says all.
    rng = np.random.default_rng(3)
    corners = np.array([(x, y, z, 1) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    corners[:, 3] = 1
    expected, samples = [], []
    for n in range(20):
        tilted = product(turn((0, 0, 1), rng.uniform(-3, 3)), turn(rng.normal(size=3), 0.3))
        ego = (rng.uniform(-500, 500, 3), tilted)
        own = (rng.uniform(-50, 50, 3), turn((0, 0, 1), rng.uniform(-3, 3)))
        size = rng.uniform(0.5, 6, 3)  # length, width, height
        world = matrix(*ego) @ matrix(*own)
        expected.append((world, corners * [*size, 1], matrix(*ego)))
        turned = rng.uniform(0.995, 1.005) * np.array(product(ego[1], own[1]))  # rounded
        geometry = map(tuple, (world[:3, 3], size[[1, 0, 2]], turned))
        box = Box("vehicle.car", *geometry, f"{n}")
        samples.append(Sample(START + n, [box], tuple(ego[0]), tuple(ego[1])))
    folder = write_nuscenes(tmp_path / "v1.0-mini", [Scene("scene-1", samples)], CATEGORIES)
    log = read_nuscenes(folder)
    assert log.boxes["frame"].tolist() == list(range(20))
    for row, (world, local, ego) in zip(log.boxes.to_dict("records"), expected, strict=True):
        cos, sin = math.cos(row["yaw"]), math.sin(row["yaw"])
        scaled = corners[:, :3] * [row["length"], row["width"], row["height"]]
        x = row["x"] + cos * scaled[:, 0] - sin * scaled[:, 1]
        y = row["y"] + sin * scaled[:, 0] + cos * scaled[:, 1]
        ours = np.stack([x + AHEAD, y, row["z"] + scaled[:, 2], np.ones(8)])
        np.testing.assert_allclose(ego @ ours, world @ local.T, atol=1e-9)
    poses = np.array([ego @ [*ORIGIN, 1] for _, _, ego in expected])
    np.testing.assert_allclose(log.frames[["ego_x", "ego_y"]], poses[:, :2], atol=1e-9)
    yaw = [math.atan2(ego[1, 0], ego[0, 0]) for _, _, ego in expected]
    np.testing.assert_allclose(log.frames["ego_yaw"], yaw, atol=1e-12)


def town(scenes=10):
    """Two recordings' worth of scenes by turns, two frames each, the second of them empty."""
    car, found = Box("vehicle.car", (9.0, 0.0, 1.0)), []
    for n in reversed(range(scenes)):
        samples = [Sample(START + n, [car]), Sample(START + n + 500_000)]
        found.append(Scene(f"scene-{n:04d}", samples, f"{n // 2}"))
    return found


def test_every_sample_is_a_frame(tmp_path):
    log = read_nuscenes(write_nuscenes(tmp_path / "v1.0-mini", town(), CATEGORIES))
    assert list(log.boxes.columns) == [*BOX_COLUMNS, "points"]
    assert {"route", *POSE_COLUMNS, "ego_z", "ego_roll"} < set(log.frames.columns)
    check_boxes(log.boxes)
    assert log.frames["frame"].tolist() == list(range(20))
    assert log.frames["scene"].tolist() == [f"scene-{n // 2:04d}" for n in range(20)]
    assert log.frames["route"].tolist() == [n // 2 for n in range(20)]
    assert log.frames["timestamp_s"].tolist() == [0.0, 0.5] * 10
    assert log.boxes["frame"].tolist() == list(range(0, 20, 2))
    assert log.boxes["object_id"].nunique() == 10
    # Counts and rigs come along.
    assert set(log.boxes["points"]) == {5}
    assert list(log.rigs) == log.frames["scene"].unique().tolist()
    rig = log.rigs["scene-0003"]
    assert rig.names == ("LIDAR_TOP",)
    (mount,) = rig.placement.mounts
    np.testing.assert_allclose(mount.position, [0.943713 - 1.294, 0, 1.84023], atol=1e-12)
    # 20 Hz: half the steps of the catalogue's.
    (lidar,) = rig.placement.lidars
    assert (lidar.beams, lidar.azimuth_steps) == (32, 1084)
    write_box_log(tmp_path / "log", log)
    read = read_box_log(tmp_path / "log")
    assert read.boxes["x"].tolist() == log.boxes["x"].tolist()


@pytest.mark.parametrize(
    ("test_scenes", "expected"),
    [
        (0.2, ["scene-0008", "scene-0009"]),
        (0.4, ["scene-0004", "scene-0005", "scene-0008", "scene-0009"]),
        (0, []),
        (1.0, [f"scene-{n:04d}" for n in range(10)]),
        (["scene-0003"], ["scene-0003"]),
    ],
)
def test_recordings_are_not_divided(tmp_path, test_scenes, expected):
    folder = write_nuscenes(tmp_path / "v1.0-mini", town(), CATEGORIES)
    frames = read_nuscenes(folder, test_scenes=test_scenes).frames
    assert frames["scene"][frames["split"] == "test"].unique().tolist() == expected
    assert set(frames["split"]) <= {"train", "test"}


def test_classes(tmp_path):
    boxes = [Box(name, (9.0, 0.0, 1.0), instance=name) for name in sorted(NUSCENES)]
    scenes = [Scene("scene-0001", [Sample(START, boxes)])]
    folder = write_nuscenes(tmp_path / "v1.0-mini", scenes, [*NUSCENES, "flat.sidewalk"])
    ignored = Counter()
    log = read_nuscenes(folder, ignored=ignored)
    assert len(NUSCENES) == 23
    assert log.boxes["class"].value_counts().to_dict() == {"Car": 2, "Cyclist": 4, "Pedestrian": 4}
    assert ignored == {name: 1 for name, value in NUSCENES.items() if value == IGNORE}
    own = read_nuscenes(folder, class_map={"vehicle.bus.rigid": "Car", "vehicle.truck": IGNORE})
    assert own.boxes["class"].value_counts()[list(CLASSES)].tolist() == [3, 3, 4]
    ignored = Counter()
    log = read_nuscenes(folder, class_map=named_class_map("own"), ignored=ignored)
    kept = {name for name in NUSCENES if name.startswith(("human.", "vehicle."))}
    assert set(log.boxes["class"]) == kept
    assert set(ignored) == set(NUSCENES) - kept
    write_box_log(tmp_path / "log", log)
    assert set(read_box_log(tmp_path / "log").boxes["class"]) == kept


def test_versions(tmp_path):
    write_nuscenes(tmp_path / "v1.0-mini", town(2), CATEGORIES)
    assert len(read_nuscenes(tmp_path).frames) == 4
    write_nuscenes(tmp_path / "v1.0-trainval", town(4), CATEGORIES)
    assert len(read_nuscenes(tmp_path, version="v1.0-trainval").frames) == 8


def test_tables_of_another_vehicle_with_two_lidars(tmp_path, monkeypatch):
    """Lyft's have three channels, and a vehicle with an origin of its own."""
    channels = {**nuscenes_layout.CHANNELS, "LIDAR_FRONT_LEFT": "lidar"}
    monkeypatch.setattr(nuscenes_layout, "CHANNELS", channels)
    folder = write_nuscenes(tmp_path / "v1.0-train", town(2), CATEGORIES)
    table = folder / "calibrated_sensor.json"
    rows = json.loads(table.read_text())
    sensors = json.loads((folder / "sensor.json").read_text())
    (left,) = [each["token"] for each in sensors if each["channel"] == "LIDAR_FRONT_LEFT"]
    for row in rows:
        row["translation"][2] -= 1.0 * (row["sensor_token"] == left)
    table.write_text(json.dumps(rows))
    rig = ("LIDAR_TOP", "LIDAR_FRONT_LEFT")
    lidar, vehicle = Lidar.named("vlp16"), replace(ZOE, origin=(0.5, 0.0, -0.3))
    log = read_nuscenes(folder, lidar=lidar, vehicle=vehicle)
    assert [each.names for each in log.rigs.values()] == [rig, rig]
    for mount, z in zip(log.rigs["scene-0001"].placement.mounts, (2.14023, 1.14023), strict=True):
        np.testing.assert_allclose(mount.position, [0.443713, 0, z], atol=1e-12)
    np.testing.assert_allclose(log.boxes[["x", "z"]], [[8.5, 1.3]] * 2, atol=1e-12)
    alone = read_nuscenes(folder, channels=["LIDAR_TOP"])
    assert alone.rigs["scene-0000"].names == rig[:1]
    for message, keys in (
        ("unknown model of LIDAR_FRONT_LEFT; name it: --lidar LIDAR_FRONT_LEFT=MODEL", {}),
        ("--channel: no LiDAR 'CAM_FRONT'; expected one of LIDAR_FR", {"channels": ["CAM_FRONT"]}),
    ):
        with pytest.raises(InputError, match=message):
            read_nuscenes(folder, **keys)
