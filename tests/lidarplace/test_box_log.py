"""The folder of a box log, and logs joined."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.box_log import BoxLog, check_listed, join_logs, read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, BUILDING_COLUMNS, check_boxes, frame_ids, points_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.tabular import read_tabular
from tests.refused import refused
from tests.sweeps.small_log import write_small_log

BOXES = pd.DataFrame(
    [
        ("town", 3, 0.0, "7", "Car", 10.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
        ("town", 5, 0.1, "7", "Car", 11.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
    ],
    columns=BOX_COLUMNS,
)
FRAMES = pd.DataFrame(
    {"scene": "town", "frame": [3, 4, 5], "timestamp_s": 0.0, "route": 0, "split": "train"}
)
POSES = FRAMES.assign(ego_x=1.0, ego_y=2.0, ego_yaw=[0.1, 0.2, 0.3])
BUILDINGS = pd.DataFrame(
    [("town", 30.0, 9.0, 4.0, 12.0, 10.0, 8.0, 0.5)], columns=list(BUILDING_COLUMNS)
)


def test_frames_are_numbered_by_scene_and_frame():
    boxes = pd.concat([BOXES, BOXES[:1]])
    assert list(frame_ids(boxes)) == [0, 1, 0]
    assert list(frame_ids(boxes.assign(scene=["a", "b", "b"], frame=0))) == [0, 1, 1]
    with refused(("", "yaw", "")):
        check_boxes(BOXES.drop(columns="yaw"))


@pytest.mark.parametrize("log", [BoxLog(BOXES, FRAMES), BoxLog(BOXES, POSES, BUILDINGS)])
def test_round_trip(tmp_path, log):
    write_box_log(tmp_path, log)
    read = read_box_log(tmp_path)
    pd.testing.assert_frame_equal(read.boxes, log.boxes, check_dtype=False)
    pd.testing.assert_frame_equal(read.frames, log.frames, check_dtype=False)
    pd.testing.assert_frame_equal(read.buildings, log.buildings, check_dtype=False)
    names = [f"{name}.parquet" for name in ("boxes", "buildings", "frames")]
    assert sorted(p.name for p in tmp_path.iterdir()) == names


RIG = RecordedRig(
    ("top", "left"),
    Placement("car", [Mount(z=2.0), Mount(y=0.8, z=1.5, yaw=1.0)], Lidar.named("vlp16")),
)
COUNTED = BOXES.assign(points=[7.0, np.nan], **{"points/top": [5.0, np.nan], "points/left": 2.0})


def test_counts_rigs_and_full_poses_come_back(tmp_path):
    frames = POSES.assign(ego_z=0.5, ego_roll=0.01, ego_pitch=-0.02)
    log = BoxLog(COUNTED, frames, rigs={"town": RIG})
    write_box_log(tmp_path, log)
    read = read_box_log(tmp_path)
    assert read.rigs == {"town": RIG}
    assert points_of(read.boxes) == {"top": "points/top", "left": "points/left"}
    pd.testing.assert_frame_equal(read.boxes, log.boxes, check_dtype=False)
    pd.testing.assert_frame_equal(read.frames, log.frames, check_dtype=False)
    assert join_logs([read, BoxLog(BOXES.iloc[:0], FRAMES.iloc[:0])]).rigs == {"town": RIG}
    again = read_tabular(tmp_path)
    assert again.rigs == {"town": RIG}
    pd.testing.assert_frame_equal(again.boxes.filter(like="points"), COUNTED.filter(like="points"))
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    assert read_box_log(tmp_path).rigs == {}


def test_a_scene_has_one_rig_that_of_its_counts(tmp_path):
    half = BoxLog(COUNTED, FRAMES, rigs={"town": RIG.subset(["top"])})
    write_box_log(tmp_path, half)
    with refused(("rig.json: scene town", "", "top")):
        read_box_log(tmp_path)
    with refused(("scene town", "", "")):
        join_logs([BoxLog(BOXES, FRAMES, rigs={"town": RIG}), half])


def test_buildings_need_poses_and_may_lack_the_file(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES, BUILDINGS))
    with refused(("frames.parquet", "ego_x, ego_y, ego_yaw", "")):
        read_box_log(tmp_path)
    (tmp_path / "buildings.parquet").unlink()
    assert tuple(read_box_log(tmp_path).buildings.columns) == BUILDING_COLUMNS


def test_a_log_that_cannot_be_written_leaves_the_old_one(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    mixed = FRAMES.assign(scene=[1, "b", "c"])
    with pytest.raises(Exception, match="convert"):
        write_box_log(tmp_path, BoxLog(BOXES[:0], mixed))
    assert len(read_box_log(tmp_path).boxes) == 2
    assert len(list(tmp_path.iterdir())) == 3, "no leftovers"


def test_joined_logs_keep_all_tables():
    log = BoxLog(BOXES, POSES, BUILDINGS)
    other = BoxLog(
        BOXES.assign(frame=[6, 7], scene="b"),
        POSES.assign(frame=[6, 7, 8], scene="b"),
        BUILDINGS.assign(scene="b"),
    )
    joined = join_logs([log, other])
    assert joined.boxes["frame"].tolist() == [3, 5, 6, 7]
    assert joined.frames["frame"].tolist() == [3, 4, 5, 6, 7, 8]
    assert joined.buildings["scene"].tolist() == ["town", "b"]


def test_unknown_times_of_some_boxes_hide_no_wrong_frames():
    frames = FRAMES.assign(timestamp_s=[0.0, 0.1, 0.2])
    boxes = BOXES.iloc[[0, 1, 1, 1]].assign(timestamp_s=[np.nan, 0.0, 0.1, 0.1])
    with refused(("boxes: row 1", "timestamp_s", "0")):
        check_listed(boxes.assign(frame=[3, 5, 5, 5]), frames, "boxes", "frames")


def test_whole_floats_and_numbers_as_names_are_taken(tmp_path):
    write_small_log(tmp_path)
    before = read_box_log(tmp_path)
    for name in ("boxes", "frames"):
        path = tmp_path / f"{name}.parquet"
        table = pd.read_parquet(path)
        table.assign(frame=table["frame"].astype(float), scene=3).to_parquet(path)
    log = read_box_log(tmp_path)
    assert log.boxes["frame"].dtype == log.frames["frame"].dtype == np.int64
    assert set(log.boxes["scene"]) == set(log.frames["scene"]) == {"3"}
    pd.testing.assert_frame_equal(log.boxes.assign(scene="a"), before.boxes)


def test_some_frames_are_those_of_the_whole_log(tmp_path):
    write_small_log(tmp_path)
    whole, some = read_box_log(tmp_path), read_box_log(tmp_path, most_frames=2)
    assert some.frames["frame"].tolist() == [0, 3]
    kept = whole.boxes[whole.boxes["frame"].isin([0, 3])].reset_index(drop=True)
    pd.testing.assert_frame_equal(some.boxes, kept)
    assert len(read_box_log(tmp_path, most_frames=99).boxes) == len(whole.boxes)
    floats = pd.read_parquet(tmp_path / "boxes.parquet").astype({"frame": float})
    floats.to_parquet(tmp_path / "boxes.parquet")
    pd.testing.assert_frame_equal(read_box_log(tmp_path, most_frames=2).boxes, kept)
