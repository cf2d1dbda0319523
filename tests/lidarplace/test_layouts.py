"""Frames in the layouts for programs of others, read back by our readers."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import PointClouds
from lidarplace.detections.read import read_detections
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds
from lidarplace.scenes.layouts import write_layout

CROP = (-60.0, -60.0, -5.0, 60.0, 60.0, 10.0)
CLASSES = ("Car", "Cyclist", "Pedestrian")


@pytest.fixture
def world():
    """Frames of two scenes, one of which has both splits; their boxes and clouds."""
    random = np.random.default_rng(0)
    frames = pd.DataFrame(
        {
            "scene": ["a b", "a b", "a b", "c", "c"],
            "frame": [3, 1, 2, 10, 11],
            "timestamp_s": [0.2, 0.0, 0.1, 5.0, 5.5],
            "route": [0, 0, 0, 1, 1],
            "split": ["test", "train", "train", "train", "test"],
        }
    )
    boxes = pd.DataFrame(
        [
            (row.scene, row.frame, row.timestamp_s, f"{name}-{k}", name)
            for row in frames.itertuples()
            for name in CLASSES
            for k in range(2)
        ],
        columns=list(BOX_COLUMNS[:5]),
    )
    for name, low, high in (("x", 5, 40), ("y", -20, 20), ("z", 0.5, 1), ("yaw", -3, 3)):
        boxes[name] = random.uniform(low, high, len(boxes))
    boxes = boxes.assign(length=4.0, width=2.0, height=1.5, occluded=0)
    labels = boxes[boxes["frame"].isin([1, 2, 10])]
    points = {
        frame: np.concatenate(
            [own[list("xyz")].to_numpy(), np.linspace(0, 1, len(own))[:, None]], axis=1
        ).astype(np.float32)
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


def as_detections(layout: str, out: Path, folder: Path) -> None:
    """The labels of a written layout as files of detections."""
    folder.mkdir()
    if layout == "kitti":
        for path in (out / "training/label_2").iterdir():
            lines = path.read_text().splitlines()
            (folder / path.name).write_text("".join(f"{line} 0.5\n" for line in lines))
    else:
        boxes = pd.read_parquet(out / "boxes.parquet").assign(score=0.5)
        boxes.to_parquet(folder / "found.parquet")


@pytest.mark.parametrize("layout", ["kitti", "parquet"])
def test_labels_fed_back_as_detections_are_the_labels(layout, world, tmp_path):
    frames, labels, clouds = world
    told = write_layout(layout, tmp_path / "out", frames, labels, clouds)
    as_detections(layout, tmp_path / "out", tmp_path / "found")
    log = BoxLog(labels[:0], told)
    found = read_detections([tmp_path / "found"], log, CLASSES, layout=layout)
    check_boxes(found, labels, 0.006 if layout == "kitti" else 1e-9)
