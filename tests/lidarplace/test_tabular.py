"""Tables of one's own: what may be left out, what fills it, and errors that name file and row."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.box_log import read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, BUILDING_COLUMNS, FRAME_COLUMNS, GEOMETRY
from lidarplace.scenes.datasets.tabular import read_tabular
from tests.refused import refused

BOXES = pd.DataFrame(
    [
        (7, "Pedestrian", 12.0, -2.0, 0.9, 0.6, 0.6, 1.8, 3.0),
        (3, "Car", 10.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
        (3, "Cyclist", 20.0, 5.0, 0.8, 1.8, 0.6, 1.7, -0.1),
    ],
    columns=["frame", "class", *GEOMETRY],
)
FRAMES = pd.DataFrame({"scene": [*"baab"], "frame": [7, 3, 4, 9], "timestamp_s": [0, 0, 0.1, 0.2]})
FRAMES["split"] = ["test", "train", "train", "test"]


def write(path, table):
    table.to_csv(path, index=False) if path.suffix == ".csv" else table.to_parquet(path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_boxes_and_a_number_of_frames(tmp_path, suffix):
    log = read_tabular(write(tmp_path / f"mine{suffix}", BOXES), frames=5)
    assert list(log.boxes.columns) == list(BOX_COLUMNS)
    assert list(log.frames.columns) == list(FRAME_COLUMNS)
    assert log.boxes["frame"].tolist() == [3, 3, 7]
    assert log.boxes["class"].tolist() == ["Car", "Cyclist", "Pedestrian"]
    expected = BOXES.sort_values("frame", kind="stable")[list(GEOMETRY)]
    np.testing.assert_array_equal(log.boxes[list(GEOMETRY)], expected)
    assert log.boxes["object_id"].is_unique
    assert log.frames["frame"].tolist() == [3, 7, 8, 9, 10]
    assert log.frames["scene"].tolist() == ["log"] * 2 + ["no boxes"] * 3
    assert set(log.frames["split"]) == {"train"}
    assert log.frames["timestamp_s"].isna().all()
    write_box_log(tmp_path / "log", log)
    assert read_box_log(tmp_path / "log").boxes["x"].tolist() == [10.0, 20.0, 12.0]
    again = read_tabular(tmp_path / "log")
    pd.testing.assert_frame_equal(again.frames, log.frames, check_dtype=False)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_folder_with_a_table_of_frames(tmp_path, suffix):
    write(tmp_path / f"boxes{suffix}", BOXES.assign(object_id=[5, 6, 5]))
    poses = {"ego_x": [1.0, 2, 3, 4], "ego_y": 0.5, "ego_yaw": -1.0, "weather": "rain"}
    write(tmp_path / f"frames{suffix}", FRAMES.assign(**poses))
    log = read_tabular(tmp_path)
    assert list(log.frames.columns) == [*FRAME_COLUMNS, "ego_x", "ego_y", "ego_yaw"]
    assert log.frames["frame"].tolist() == [3, 4, 7, 9]
    assert log.frames["route"].tolist() == [0, 0, 1, 1]
    assert log.frames["split"].tolist() == ["train", "train", "test", "test"]
    assert log.frames["ego_x"].tolist() == [2.0, 3.0, 1.0, 4.0]
    assert log.boxes["scene"].tolist() == ["a", "a", "b"]
    assert log.boxes["object_id"].tolist() == ["6", "5", "5"]
    assert log.boxes["timestamp_s"].tolist() == [0.0, 0.0, 0.0]


def test_a_box_log_comes_back_as_it_is(tmp_path):
    write(tmp_path / "boxes.csv", BOXES)
    write(tmp_path / "frames.csv", FRAMES.assign(ego_x=1.0, ego_y=2.0, ego_yaw=0.5))
    building = ("a", 30.0, 9.0, 4.0, 12.0, 10.0, 8.0, 0.5)
    buildings = pd.DataFrame([building], columns=list(BUILDING_COLUMNS))
    log = replace(read_tabular(tmp_path), buildings=buildings)
    write_box_log(tmp_path / "log", log)
    again = read_tabular(tmp_path / "log")
    for name in ("boxes", "frames", "buildings"):
        mine, theirs = getattr(again, name), getattr(log, name)
        pd.testing.assert_frame_equal(mine, theirs, check_dtype=False)
    write(tmp_path / "log" / "buildings.parquet", buildings.assign(width=-1.0))
    with refused(("buildings.parquet: row 0", "width", "")):
        read_tabular(tmp_path / "log")


def test_scene_and_time_of_boxes_alone(tmp_path):
    boxes = BOXES.assign(scene=["b", "a", "a"], timestamp_s=[0.4, 0.2, 0.2])
    log = read_tabular(write(tmp_path / "boxes.csv", boxes), frames=2)
    own = log.frames[["scene", "route", "timestamp_s"]].to_numpy().tolist()
    assert own == [["a", 0, 0.2], ["b", 1, 0.4]]
    assert log.boxes["timestamp_s"].tolist() == [0.2, 0.2, 0.4]


def test_class_map(tmp_path):
    boxes = BOXES.assign(**{"class": ["bollard", "Car", "van"]})
    path = write(tmp_path / "boxes.csv", boxes)
    ignored = Counter()
    own = {"van": "Cyclist", "bollard": "ignore"}
    log = read_tabular(path, frames=2, class_map=own, ignored=ignored)
    assert log.boxes["class"].tolist() == ["Car", "Cyclist"]
    assert log.frames["frame"].tolist() == [3, 7]  # 7 has lost its only box and counts
    assert ignored == {"bollard": 1}
    log = read_tabular(write(tmp_path / "boxes.csv", BOXES[:0]), frames=3)
    assert len(log.boxes) == 0
    assert log.frames["frame"].tolist() == [0, 1, 2]
    write_box_log(tmp_path / "log", log)
    assert len(read_box_log(tmp_path / "log").frames) == 3


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_names_that_are_numbers_are_text(tmp_path, suffix):
    boxes = BOXES.assign(scene=[2, 1, 1], object_id=[4, 5, 6])
    boxes["class"] = [3, 1, 1]
    path = write(tmp_path / f"mine{suffix}", boxes)
    log = read_tabular(path, frames=4, class_map={"1": "Car", "3": "Pedestrian"})
    assert log.boxes["class"].tolist() == ["Car", "Car", "Pedestrian"]
    assert log.boxes["scene"].tolist() == ["1", "1", "2"]
    assert log.boxes["object_id"].tolist() == ["5", "6", "4"]
    assert set(log.frames["scene"]) == {"1", "2", "no boxes"}
    write_box_log(tmp_path / "log", log)
    assert len(read_box_log(tmp_path / "log").frames) == 4
