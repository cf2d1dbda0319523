import pandas as pd

from lidarplace.logs.boxes import BOX_COLUMNS, check_boxes, frame_ids
from tests.refused import refused

BOXES = pd.DataFrame(
    [
        ("town", 3, 0.0, 7, "Car", 10.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
        ("town", 5, 0.1, 7, "Car", 11.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
        ("town", 3, 0.0, 8, "Pedestrian", 5.0, -2.0, 0.9, 0.5, 0.5, 1.8, 0.0),
    ],
    columns=BOX_COLUMNS,
)


def test_frames_are_numbered_by_scene_and_frame():
    assert list(frame_ids(BOXES)) == [0, 1, 0]
    two_scenes = BOXES.assign(scene=["a", "b", "b"], frame=0)
    assert list(frame_ids(two_scenes)) == [0, 1, 1]


def test_missing_column():
    with refused(("", "yaw", "")):
        check_boxes(BOXES.drop(columns="yaw"))
