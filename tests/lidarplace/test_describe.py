"""What a box log holds, counted by hand."""

import pandas as pd

from lidarplace.commands.describe import describe
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS
from sweeps.command_line import app
from tests.sweeps.toy import call

FRAMES = pd.DataFrame({"scene": ["a", "a", "b"], "frame": [0, 1, 2], "timestamp_s": 0.0})
FRAMES = FRAMES.assign(route=[0, 0, 1], split=["train", "train", "test"])


def box(scene: str, frame: int, name: str, x: float, y: float = 0.0) -> tuple:
    return (scene, frame, 0.0, f"{frame}-{x}", name, x, y, 0.8, 4.0, 2.0, 1.6, 0.0)


ROWS = [box("a", 0, "Car", x) for x in (10, -10, 50)]
ROWS += [box("a", 0, "Pedestrian", 5, 25), box("b", 2, "Cyclist", 40)]
BOXES = pd.DataFrame(ROWS, columns=BOX_COLUMNS)


def test_objects_per_frame_by_region():
    found = describe(BoxLog(BOXES, FRAMES)).set_index("scene")
    assert found["frames"].to_dict() == {"a": 2, "b": 1, "all": 3}
    assert found["routes"].to_dict() == {"a": 1, "b": 1, "all": 2}
    assert found["ROI Car"].to_list() == [1.0, 0.0, 2 / 3]
    assert found["front Car"].to_list() == [0.5, 0.0, 1 / 3]
    assert found["front Cyclist"].to_list() == [0.0, 1.0, 1 / 3], "a face belongs to the region"
    assert (found["ROI Pedestrian"] == 0).all()


def test_a_split_that_is_missing_is_no_number():
    found = describe(BoxLog(BOXES, FRAMES.assign(split=["train", "train", None])))
    assert set(found["split"]) == {"train", ""}


def test_a_log_without_boxes():
    found = describe(BoxLog(BOXES[:0], FRAMES))
    assert (found.filter(like="Car") == 0).all(axis=None)


def test_command(tmp_path):
    write_box_log(tmp_path / "log", BoxLog(BOXES, FRAMES))
    done = call(app, "describe", str(tmp_path / "log"))
    assert "0.67" in done.stdout
