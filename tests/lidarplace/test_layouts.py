"""Frames in the layouts for programs of others, read back by our readers."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import PointClouds
from lidarplace.detections.read import read_detections
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, GEOMETRY
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds
from lidarplace.scenes.layouts import write_layout

CROP = (-60.0, -60.0, -5.0, 60.0, 60.0, 10.0)
CLASSES = ("Car", "Cyclist", "Pedestrian")


@pytest.fixture
def world():
    """Frames of two scenes, one of which has both splits; their boxes and clouds."""
    random = np.random.default_rng(0)
    rows = [("a b", 3, 0.2, 0, "test"), ("a b", 1, 0.0, 0, "train"), ("a b", 2, 0.1, 0, "train")]
    rows += [("c", 10, 5.0, 1, "train"), ("c", 11, 5.5, 1, "test")]
    frames = pd.DataFrame(rows, columns=list(FRAME_COLUMNS))
    named = [(*row[:3], f"{name}-{k}", name) for row in rows for name in CLASSES for k in range(2)]
    boxes = pd.DataFrame(named, columns=list(BOX_COLUMNS[:5]))
    for name, low, high in (("x", 5, 40), ("y", -20, 20), ("z", 0.5, 1), ("yaw", -3, 3)):
        boxes[name] = random.uniform(low, high, len(boxes))
    boxes = boxes.assign(length=4.0, width=2.0, height=1.5, occluded=0)
    labels = boxes[boxes["frame"].isin([1, 2, 10])]
    points = {
        frame: np.c_[own[list("xyz")], np.linspace(0, 1, len(own))].astype(np.float32)
        for frame, own in boxes.groupby("frame")
    }
    clouds = PointClouds.from_frames(list(points), ((p, [len(p)]) for p in points.values()), CROP)
    return frames, labels, clouds


def check_boxes(found, labels, atol):
    """The same boxes in the same frames."""
    keys = ["frame", "class", "x"]
    one, two = (table.sort_values(keys, ignore_index=True) for table in (found, labels))
    assert one["class"].tolist() == two["class"].tolist()
    ours, theirs = (table[list(GEOMETRY)].to_numpy() for table in (one, two))
    assert np.allclose(ours, theirs, atol=atol)


def test_kitti(world, tmp_path):
    frames, labels, clouds = world
    told = write_layout("kitti", tmp_path / "out", frames, labels, clouds)
    assert set(told["source"]) == {f"{n:06d}" for n in frames["frame"]}
    log = read_kitti(tmp_path / "out")
    assert log.frames["frame"].tolist() == [1, 2, 10]
    check_boxes(log.boxes, labels, 0.006)
    assert not (tmp_path / "out/testing/label_2").exists()
    assert (tmp_path / "out/ImageSets/test.txt").read_text() == "000003\n000011\n"
    assert (tmp_path / "out/ImageSets/val.txt").read_text() == ""
    own = read_kitti_clouds(tmp_path / "out/testing", [3, 11], CROP)
    at = clouds.frames.tolist().index(3)
    assert np.allclose(own[0], clouds[at], atol=2e-3)


def test_plain(world, tmp_path):
    frames, labels, clouds = world
    write_layout("parquet", tmp_path / "out", frames, labels, clouds)
    check_boxes(pd.read_parquet(tmp_path / "out/boxes.parquet"), labels, 0)
    own = np.fromfile(tmp_path / "out/clouds/000003.bin", np.float32).reshape(-1, 4)
    assert np.array_equal(own, clouds[clouds.frames.tolist().index(3)])
    splits = pd.read_parquet(tmp_path / "out/frames.parquet").set_index("frame")["split"]
    assert splits[3] == "test"


@pytest.mark.parametrize("layout", ["kitti", "parquet"])
def test_labels_fed_back_as_detections_are_the_labels(layout, world, tmp_path):
    frames, labels, clouds = world
    log = BoxLog(labels[:0], write_layout(layout, tmp_path / "out", frames, labels, clouds))
    (folder := tmp_path / "found").mkdir()
    if layout == "kitti":
        for path in (tmp_path / "out/training/label_2").iterdir():
            (folder / path.name).write_text(path.read_text().replace("\n", " 0.5\n"))
    else:
        boxes = pd.read_parquet(tmp_path / "out/boxes.parquet").assign(score=0.5)
        boxes.to_parquet(folder / "found.parquet")
    found = read_detections([folder], log, CLASSES, layout=layout)
    check_boxes(found, labels, 0.006 if layout == "kitti" else 1e-9)
