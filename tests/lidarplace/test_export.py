"""`lidarplace export`, its result read by code that is not the exporter's."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.collect import collect
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.commands.export import app
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, GEOMETRY
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from lidarplace.scenes.kitti.read import read_kitti
from tests.lidarplace.kitti_reader import read_frame
from tests.sweeps.toy import call


@pytest.fixture
def log(tmp_path) -> BoxLog:
    """Three frames: two with objects, one without; written to `tmp_path / "log"`."""
    rows = [
        (0, "Car", 12.0, 3.0, 0.8, 4.4, 1.8, 1.6, 0.4),
        (0, "Cyclist", 22.0, -6.0, 1.5, 6.5, 2.5, 3.0, -2.2),
        (0, "Pedestrian", 8.0, 1.0, 0.9, 0.6, 0.6, 1.8, 1.0),
        (0, "Car", 4.0, 14.0, 0.8, 4.4, 1.8, 1.6, 0.1),  # beside the image
        (0, "Car", -12.0, 3.0, 0.8, 4.4, 1.8, 1.6, 0.4),  # outside the ROI
        (0, "Pedestrian", 22.5, -5.4, 2.0, 0.3, 0.3, 0.3, 0.0),  # within the truck
        (5, "Cyclist", 9.0, -2.0, 0.8, 1.8, 0.6, 1.7, 1.6),
    ]
    boxes = pd.DataFrame(rows, columns=["frame", "class", *GEOMETRY])
    boxes = boxes.assign(scene="s", timestamp_s=0.0, object_id=[f"o{i}" for i in range(len(rows))])
    frames = pd.DataFrame({"frame": [0, 5, 9], "split": ["train", "test", "train"]})
    frames = frames.assign(scene="s", timestamp_s=0.0, route=0)
    made = BoxLog(boxes[list(BOX_COLUMNS)], frames[list(FRAME_COLUMNS)])
    write_box_log(tmp_path / "log", made)
    return made


def run(*arguments) -> str:
    result = call(app, *arguments)
    return result.output


def test_labels_hold_the_points_of_their_objects(tmp_path, log) -> None:
    out = tmp_path / "kitti"
    text = run(tmp_path / "log", out, "--placement", "line_roll")
    left_out = ("1 objects of the ROI left out", "1 objects outside the image left out")
    assert all(told in text for told in ("3 frames, 4 labels", *left_out))
    crop = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)
    clouds = collect(log, [0, 5, 9], PAPER_PLACEMENTS["line_roll"], crop)
    for index, (stem, rows) in enumerate((("000000", [0, 1, 2]), ("000005", [6]))):
        frame = read_frame(out, stem)
        assert [item.name for item in frame.objects] == log.boxes["class"][rows].tolist()
        assert len(frame.points) == len(clouds[index])
        # Most points lie on the surface, which labels and clouds round by 5 and 0.5 mm.
        boxes = log.boxes[list(GEOMETRY)].to_numpy(float)[rows]
        least = count_points(clouds[index], boxes)
        most = count_points(clouds[index], boxes + np.array([0, 0, 0, 0.06, 0.06, 0.06, 0]))
        found = np.array([item.holds(frame.points, 0.015).sum() for item in frame.objects])
        assert ((least <= found) & (found <= most) & (least > 20)).all()
        for item in frame.objects:
            pixels = frame.pixels(frame.points[item.holds(frame.points)])
            assert (pixels >= item.image_box[:2] - 1).all()
            assert (pixels <= item.image_box[2:] + 1).all()
    assert read_frame(out, "000009").objects[0].name == "DontCare"


def test_all_around_has_every_object_of_the_ground_truth(tmp_path, log) -> None:
    out = tmp_path / "kitti"
    text = run(tmp_path / "log", out, "--placement", "center", "--all-around", "--images")
    assert "5 labels" in text
    assert "1 objects outside the image labelled all the same" in text
    assert len(list((out / "training" / "image_2").iterdir())) == 3
    back = read_kitti(out)
    splits = dict(zip(back.frames["frame"], back.frames["split"], strict=True))
    assert splits == {0: "train", 5: "test", 9: "train"}
    kept = log.boxes.iloc[[0, 1, 2, 3, 6]]
    assert back.boxes["class"].tolist() == kept["class"].tolist()
    np.testing.assert_allclose(back.boxes[list(GEOMETRY)], kept[list(GEOMETRY)], atol=0.0076)


def test_split_region_profile_and_own_placement(tmp_path, log) -> None:
    (tmp_path / "mine.yaml").write_text("mounts: [{z: 2.2}]")
    out = tmp_path / "kitti"
    options = ("--placement", tmp_path / "mine.yaml", "--split", "test")
    roi = ("--roi", 0, 20, -10, 10, 0, 4)
    run(tmp_path / "log", out, *options, *roi, "--profile", "released-code")
    sets = {path.stem: path.read_text().split() for path in (out / "ImageSets").iterdir()}
    assert sets == {"train": [], "val": ["000005"], "trainval": ["000005"], "test": []}
    points = read_frame(out, "000005").points
    assert 0 < len(points) <= 4000
    assert np.abs(points[:, 0]).max() <= 10
