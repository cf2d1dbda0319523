"""Data in Place3D's layout: nuScenes' tables of one placement, one merged cloud a frame."""

import json
import random

import numpy as np
import pytest

from lidarplace.commands.convert import app
from lidarplace.logs.box_log import read_box_log, read_rigs
from sweeps.plan.plan import read_plan
from tests.lidarplace.nuscenes_layout import Box, Sample, Scene, write_nuscenes
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call
from tracking.published import place3d_detection, place3d_placements

CATEGORIES = ["vehicle.car", "vehicle.bus.rigid", "human.pedestrian.adult"]
HEIGHT = 1.8


@pytest.fixture
def place3d(tmp_path):
    """Scenes as its scripts write them: one recording, one LiDAR, x of its points to the right."""
    boxes = [
        Box("vehicle.car", (10 + 3 * n, 6.0 - 3 * n, 0.75), instance=f"car{n}") for n in range(5)
    ]
    scenes = [
        Scene(f"carla-{number}", [Sample(1000 * number + n, boxes) for n in range(2)], "carla")
        for number in range(1001, 1006)
    ]
    folder = tmp_path / "center"
    tables = write_nuscenes(folder / "v1.0-trainval", scenes, CATEGORIES)
    mounts = json.loads((tables / "calibrated_sensor.json").read_text())
    for mount in mounts:
        mount |= {"translation": [0, 0, HEIGHT], "rotation": [0.707, 0, 0, -0.707]}
    (tables / "calibrated_sensor.json").write_text(json.dumps(mounts))
    clouds = json.loads((tables / "sample_data.json").read_text())
    for cloud in clouds:
        if "LIDAR_TOP" in cloud["filename"]:
            stamp = cloud["filename"].rpartition("/")[2]
            cloud["filename"] = f"samples/LIDAR_TOP/n008__LIDAR_TOP__{stamp}.pcd.bin"
            write_cloud(folder / cloud["filename"], boxes)
    (tables / "sample_data.json").write_text(json.dumps(clouds))
    return folder


def write_cloud(path, boxes):
    """Points just inside of the boxes, in the frame of the LiDAR."""
    path.parent.mkdir(parents=True, exist_ok=True)
    around = random.Random(1)
    points = [
        (
            box.translation[0] + around.uniform(-0.49, 0.49) * box.size[1],
            box.translation[1] + around.uniform(-0.49, 0.49) * box.size[0],
            box.translation[2] + around.uniform(-0.49, 0.49) * box.size[2],
        )
        for box in boxes
        for _ in range(30)
    ]
    x, y, z = np.array(points).T
    rows = np.stack([-y, x, z - HEIGHT, 0 * x, 0 * x], axis=1)
    rows.astype(np.float32).tofile(path)


def test_it_is_read_as_a_recorded_placement(tmp_path, place3d, monkeypatch):
    (tmp_path / "val.txt").write_text("carla-1005\n")
    monkeypatch.chdir(tmp_path)
    call(app, "nuscenes", "center", "log", "--test-scenes", "val.txt", "--clouds", "center")
    log = read_box_log(tmp_path / "log")
    assert log.frames.groupby("split").size().to_dict() == {"test": 2, "train": 8}
    assert (log.boxes["class"] == "Car").all()
    rigs = read_rigs(tmp_path / "log")
    assert {rig.names for rig in rigs.values()} == {("LIDAR_TOP",)}
    assert rigs["carla-1001"].placement.mounts[0].z == pytest.approx(HEIGHT)
    scene = {"source": "log", "folder": "log", "clouds": "recorded"}
    keys = {"placements": {"merged": {"recorded": ["LIDAR_TOP"]}}, "placement": "merged"}
    _, plan = read_plan(write_sweep(tmp_path, scene=scene, **keys))
    (trial,) = plan.trials
    (test,) = trial.collect_test
    found = test.stage.run(log)
    assert len(found.frames) == 2
    assert (found.points_per_object["points"] == 30).all()


def test_its_published_tables():
    table = place3d_detection()
    assert len(table) == 4 * 8 * 3
    # The averages that it prints.
    means = table.groupby(["placement", "class"])["value"].mean()
    for placement, printed in {
        "center": (52.5, 26.9, 29.4),
        "line_roll": (51.0, 28.3, 31.5),
        "optimised": (53.4, 30.0, 32.0),
    }.items():
        own = means[placement][["Car", "Pedestrian", "Bicycle"]].to_numpy()
        assert own == pytest.approx(printed, abs=0.06)
    rigs = place3d_placements()
    assert (rigs.groupby("placement")["beams"].sum() == 64).all()
    assert set(rigs["placement"]) < set(table["placement"])
