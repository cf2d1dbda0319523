"""OpenLABEL: a file of the format's own library, boxes by hand, errors that name the place."""

import json
import math
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from lidarplace.base.errors import InputError
from lidarplace.commands.convert import app
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS
from lidarplace.scenes.datasets.openlabel import read_openlabel
from tests.sweeps.toy import call

DRIVE = Path(__file__).parents[1] / "data/openlabel/drive.json"
AXLE = (-1.4, 0.0, 0.3)


def test_a_file_of_the_formats_library():
    ignored = Counter()
    own = {"kiosk": "Car", "Pedestrian": "ignore"}
    log = read_openlabel(DRIVE, origin=AXLE, class_map=own, ignored=ignored)
    assert ignored == {"Pedestrian": 2}
    assert log.frames["timestamp_s"].tolist() == [0.0, 0.5]
    # The vehicle stands at the origin of the world, then 2 m ahead, turned by 0.2.
    c, s = math.cos(0.2), math.sin(0.2)
    ego = [[1.4, 0.0, 0.0], [2 + 1.4 * c, 1.4 * s, 0.2]]
    np.testing.assert_allclose(log.frames[list(POSE_COLUMNS)], ego, atol=1e-12)
    # The kiosk stands at (30, 0) of the world; in the second frame it is seen from there.
    car, kiosk = [2.0, 0.8, 4.5, 1.9, 1.6, 0.3], [1.3, 3.0, 3.0, 2.0]
    seen = [28 * c - 1.4, -28 * s, *kiosk, -0.2]
    expected = [[8.6, *car], [28.6, 0.0, *kiosk, 0.0], [9.6, *car], seen]
    np.testing.assert_allclose(log.boxes[list(GEOMETRY)], expected, atol=1e-12)
    assert log.boxes["object_id"].tolist() == ["0", "2", "0", "2"]
    # A cuboid in the frame of a sensor.
    log = read_openlabel(DRIVE, origin=(0.0, 0.0, 0.0), class_map={"kiosk": "ignore"})
    person = log.boxes[log.boxes["class"] == "Pedestrian"].iloc[0]
    # The LiDAR is 1.2 m ahead and 1.6 m up; the quaternion turns by 0.8.
    expected = [5.0 + 1.2, -1.0, -0.9 + 1.6, 0.6, 0.7, 1.8, 0.8]
    np.testing.assert_allclose(person[list(GEOMETRY)].to_numpy(float), expected, atol=1e-12)


def test_a_folder_of_drives_by_the_command(tmp_path):
    for name in ("b", "a"):
        (tmp_path / "drives").mkdir(exist_ok=True)
        shutil.copy(DRIVE, tmp_path / "drives" / f"{name}.json")
    (tmp_path / "map.yaml").write_text("kiosk: ignore\n")
    line = ["openlabel", tmp_path / "drives", tmp_path / "log", "--origin", *AXLE, "--test", "b"]
    words = [str(word) for word in [*line, "--class-map", tmp_path / "map.yaml"]]
    done = call(app, *words)
    assert "ignored: kiosk" in done.output
    log = read_box_log(tmp_path / "log")
    assert log.frames["scene"].tolist() == ["a", "a", "b", "b"]
    assert log.frames["frame"].tolist() == [0, 1, 2, 3]
    assert log.frames["split"].tolist() == ["train", "train", "test", "test"]
    assert log.boxes["frame"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def changed(tmp_path, change):
    content = json.loads(DRIVE.read_text())
    change(content["openlabel"])
    path = tmp_path / "drive.json"
    path.write_text(json.dumps(content))
    return path


def test_what_is_told_once_holds_in_its_frames(tmp_path):
    def once(content):
        kiosk = content["frames"]["0"]["objects"]["2"]["object_data"]
        for frame in content["frames"].values():
            del frame["objects"]["2"]
        content["objects"]["2"]["object_data"] = kiosk
        content["objects"]["2"]["frame_intervals"] = [{"frame_start": 1, "frame_end": 1}]

    log = read_openlabel(changed(tmp_path, once), origin=AXLE, class_map={"kiosk": "Car"})
    kiosk = log.boxes[log.boxes["object_id"] == "2"]
    assert kiosk["frame"].tolist() == [1]


@pytest.mark.parametrize(
    ("stamps", "unit", "expected"),
    [
        ([1_000_000, 1_100_000], 1e-6, [0.0, 0.1]),
        (["2026-03-04T10:00:00Z", "2026-03-04T10:00:00.5Z"], 1.0, [0.0, 0.5]),
        ([None, 3.0], 1.0, [math.nan, 0.0]),
    ],
)
def test_time_stamps(stamps, unit, expected, tmp_path):
    def times(content):
        for frame, stamp in zip(content["frames"].values(), stamps, strict=True):
            frame["frame_properties"]["timestamp"] = stamp

    path = changed(tmp_path, times)
    log = read_openlabel(path, origin=AXLE, seconds=unit, class_map={"kiosk": "Car"})
    np.testing.assert_allclose(log.frames["timestamp_s"], expected, atol=1e-9)


CAMERA = [0, 0, 1, 1.0, -1, 0, 0, 0, 0, -1, 0, 1.6, 0, 0, 0, 1]  # x right, y down, z ahead
LYING = [1, 0, 0, 0, 0, 0.6, -0.8, 0, 0, 0.8, 0.6, 0, 0, 0, 0, 1]  # rolled by 53 degrees


def in_camera(tmp_path, matrix):
    """A car 21 m ahead, its sizes along x right, y down and z ahead, as VCD converts KITTI's."""
    systems = {
        "car": {"type": "local_cs", "parent": ""},
        "CAM": {"type": "sensor_cs", "parent": "car", "pose_wrt_parent": {"matrix4x4": matrix}},
    }
    cuboid = {"coordinate_system": "CAM", "val": [0.0, 0.85, 20.0, 0, 0, 0, 4.3, 1.5, 1.8]}
    frame = {"objects": {"1": {"object_data": {"cuboid": [cuboid]}}}}
    content = {"coordinate_systems": systems, "objects": {"1": {"type": "Car"}}}
    path = tmp_path / "box.json"
    path.write_text(json.dumps({"openlabel": content | {"frames": {"0": frame}}}))
    return path


def test_a_cuboid_in_the_frame_of_a_camera(tmp_path):
    log = read_openlabel(in_camera(tmp_path, CAMERA), origin=(0.0, 0.0, 0.0))
    expected = [21.0, 0.0, 0.75, 4.3, 1.8, 1.5, -math.pi / 2]
    np.testing.assert_allclose(log.boxes[list(GEOMETRY)].iloc[0].to_numpy(float), expected)
    with pytest.raises(InputError, match="object 1 in CAM: expected a cuboid on the ground"):
        read_openlabel(in_camera(tmp_path, LYING), origin=(0.0, 0.0, 0.0))
