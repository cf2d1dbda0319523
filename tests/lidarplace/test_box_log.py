"""The folder of a box log, and logs joined."""

import pandas as pd
import pytest

from lidarplace.box_log import BoxLog, join_logs, read_box_log, write_box_log
from lidarplace.boxes import BOX_COLUMNS, BUILDING_COLUMNS

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


@pytest.mark.parametrize("log", [BoxLog(BOXES, FRAMES), BoxLog(BOXES, POSES, BUILDINGS)])
def test_round_trip(tmp_path, log):
    write_box_log(tmp_path, log)
    read = read_box_log(tmp_path)
    pd.testing.assert_frame_equal(read.boxes, log.boxes, check_dtype=False)
    pd.testing.assert_frame_equal(read.frames, log.frames, check_dtype=False)
    pd.testing.assert_frame_equal(read.buildings, log.buildings, check_dtype=False)
    names = [f"{name}.parquet" for name in ("boxes", "buildings", "frames")]
    assert sorted(p.name for p in tmp_path.iterdir()) == names


def test_a_log_without_buildings_may_lack_the_file(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    (tmp_path / "buildings.parquet").unlink()
    assert tuple(read_box_log(tmp_path).buildings.columns) == BUILDING_COLUMNS


def test_buildings_need_poses(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES, BUILDINGS))
    with pytest.raises(ValueError, match=r"frames\.parquet: no column ego_x, ego_y, ego_yaw"):
        read_box_log(tmp_path)


def test_what_is_no_log_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"boxes\.parquet: no such file"):
        read_box_log(tmp_path)
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    (tmp_path / "frames.parquet").write_bytes(b"no parquet at all")
    with pytest.raises(ValueError, match=r"frames\.parquet: is no Parquet file"):
        read_box_log(tmp_path)


def test_a_frame_has_a_number_of_its_own(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES[:1], FRAMES.assign(scene=["a", "b", "c"], frame=3)))
    with pytest.raises(ValueError, match=r"frames\.parquet: row 1: frame 3 is there twice"):
        read_box_log(tmp_path)


def test_a_log_that_cannot_be_written_leaves_the_old_one(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES))
    mixed = FRAMES.assign(scene=[1, "b", "c"])
    with pytest.raises(Exception, match="convert"):
        write_box_log(tmp_path, BoxLog(BOXES[:0], mixed))
    assert len(read_box_log(tmp_path).boxes) == 2
    assert len(list(tmp_path.iterdir())) == 3, "no leftovers"


def test_every_box_belongs_to_a_listed_frame(tmp_path):
    write_box_log(tmp_path, BoxLog(BOXES, FRAMES[:2]))
    with pytest.raises(ValueError, match=r"boxes\.parquet: row 1: frame 5 is not in frames"):
        read_box_log(tmp_path)


def test_joined_logs_keep_all_tables_and_refuse_a_frame_twice():
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
    with pytest.raises(ValueError, match="frame 3 is in two of the logs"):
        join_logs([log, log])
    with pytest.raises(ValueError, match="no box log"):
        join_logs([])
