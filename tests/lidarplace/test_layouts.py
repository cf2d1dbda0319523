"""Frames in the layouts of data sets, read back by our readers."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.cloud_files import read_cloud
from lidarplace.clouds.clouds import PointClouds
from lidarplace.detections.read import read_detections
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY
from lidarplace.scenes.datasets import argoverse, write_nuscenes
from lidarplace.scenes.datasets.argoverse import read_argoverse
from lidarplace.scenes.datasets.nuscenes import ORIGIN, read_nuscenes
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds
from lidarplace.scenes.layouts import write_layout

CROP = (-60.0, -60.0, -5.0, 60.0, 60.0, 10.0)
CLASSES = ("Car", "Cyclist", "Pedestrian")


@pytest.fixture
def world():
    """Frames of two scenes, one of which has both splits and no poses of the vehicle; their boxes
    and clouds."""
    random = np.random.default_rng(0)
    frames = pd.DataFrame(
        {
            "scene": ["a b", "a b", "a b", "c", "c"],
            "frame": [3, 1, 2, 10, 11],
            "timestamp_s": [0.2, 0.0, 0.1, 5.0, 5.5],
            "route": [0, 0, 0, 1, 1],
            "split": ["test", "train", "train", "train", "test"],
            "ego_x": [1.0, 0.0, 0.5, np.nan, np.nan],
            "ego_y": [4.0, 2.0, 3.0, np.nan, np.nan],
            "ego_yaw": [0.3, 0.1, 0.2, np.nan, np.nan],
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
    """The same boxes in the same frames; `found` has frames of its own numbers in `frame`."""
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


def test_nuscenes(world, tmp_path):
    frames, labels, clouds = world
    told = write_layout("nuscenes", tmp_path / "out", frames, labels, clouds)
    number = dict(zip(told["source"], told["frame"], strict=True))
    log = read_nuscenes(tmp_path / "out", version="v1.0-trainval", test_scenes=0.0)
    samples = pd.read_json(tmp_path / "out/v1.0-trainval/sample.json", dtype={"token": str})
    assert {number[token] for token in samples["token"]} == {1, 2, 10}
    numbered = log.frames["cloud"].str.extract(r"/(\d+)\.pcd")[0].astype(int)
    of_frame = dict(zip(log.frames["frame"], numbered, strict=True))
    boxes = log.boxes.assign(frame=log.boxes["frame"].map(of_frame))
    check_boxes(boxes, labels, 1e-9)
    assert (boxes["points"] == 1).all()
    assert log.boxes.groupby("object_id")["frame"].count().max() == 2
    test = tmp_path / "out/v1.0-test"
    assert len(list(test.iterdir())) == 13
    assert (test / "sample_annotation.json").read_text() == "[]"
    for path in (tmp_path / "out").glob("samples/LIDAR_TOP/*.bin"):
        cloud = read_cloud(path)
        turned = write_nuscenes.SENSOR.rotation[0].apply(cloud[list("xyz")].to_numpy())
        own = turned + write_nuscenes.SENSOR.position - ORIGIN
        points = clouds[clouds.frames.tolist().index(int(path.name.partition(".")[0]))]
        assert np.allclose(own, points[:, :3], atol=1e-4)
        assert np.allclose(cloud["intensity"], points[:, 3], atol=1e-2)


def test_argoverse(world, tmp_path):
    frames, labels, clouds = world
    told = write_layout("argoverse", tmp_path / "out", frames, labels, clouds)
    number = dict(zip(told["source"], told["frame"], strict=True))
    log = read_argoverse(tmp_path / "out", splits=("train",))
    parts = log.frames["cloud"].str.removesuffix(".feather").str.split("/")
    names = parts.map(lambda words: number[f"{words[1]}/{words[-1]}"])
    boxes = log.boxes.assign(frame=log.boxes["frame"].map(dict(enumerate(names))))
    check_boxes(boxes, labels, 1e-9)
    assert not list((tmp_path / "out/test").glob("*/annotations.feather"))
    for name, frame in number.items():
        log_id, time = name.split("/")
        (path,) = (tmp_path / "out").glob(f"*/{log_id}/sensors/lidar/{time}.feather")
        points = clouds[clouds.frames.tolist().index(frame)]
        own = read_cloud(path)[list("xyz")].to_numpy() + argoverse.CLOUDS_ORIGIN
        assert np.allclose(own, points[:, :3], atol=1e-4)


def test_plain(world, tmp_path):
    frames, labels, clouds = world
    write_layout("parquet", tmp_path / "out", frames, labels, clouds)
    check_boxes(pd.read_parquet(tmp_path / "out/boxes.parquet"), labels, 0)
    own = np.fromfile(tmp_path / "out/clouds/000003.bin", np.float32).reshape(-1, 4)
    assert np.array_equal(own, clouds[clouds.frames.tolist().index(3)])
    splits = pd.read_parquet(tmp_path / "out/frames.parquet").set_index("frame")["split"]
    assert splits[3] == "test"


def test_frames_without_times_follow_each_other(world, tmp_path):
    frames, labels, clouds = world
    told = write_layout(
        "argoverse", tmp_path / "out", frames.assign(timestamp_s=np.nan), labels, clouds
    )
    times = told.groupby("sequence")["time_us"].apply(list).tolist()
    assert times == [[0, 100_000, 200_000], [0, 100_000]]


def as_detections(layout: str, out: Path, folder: Path) -> None:
    """The labels of a written layout as files of detections."""
    folder.mkdir()
    if layout == "kitti":
        for path in (out / "training/label_2").iterdir():
            lines = path.read_text().splitlines()
            (folder / path.name).write_text("".join(f"{line} 0.5\n" for line in lines))
    elif layout == "nuscenes":
        tables = {
            name: json.loads((out / f"v1.0-trainval/{name}.json").read_text())
            for name in ("sample_annotation", "instance")
        }
        names = {row["token"]: row["category_token"] for row in tables["instance"]}
        results = {}
        for row in tables["sample_annotation"]:
            box = {"detection_name": names[row["instance_token"]], "detection_score": 0.5}
            box |= {name: row[name] for name in ("translation", "size", "rotation")}
            results.setdefault(row["sample_token"], []).append(box)
        (folder / "found.json").write_text(json.dumps({"meta": {}, "results": results}))
    elif layout == "argoverse":
        for log in (out / "train").iterdir():
            found = pd.read_feather(log / "annotations.feather").assign(log_id=log.name, score=0.5)
            found.to_feather(folder / f"{log.name}.feather")
    else:
        boxes = pd.read_parquet(out / "boxes.parquet").assign(score=0.5)
        boxes.to_parquet(folder / "found.parquet")


@pytest.mark.parametrize("layout", ["kitti", "nuscenes", "argoverse", "parquet"])
def test_labels_fed_back_as_detections_are_the_labels(layout, world, tmp_path):
    frames, labels, clouds = world
    told = write_layout(layout, tmp_path / "out", frames, labels, clouds)
    as_detections(layout, tmp_path / "out", tmp_path / "found")
    log = BoxLog(labels[:0], told)
    found = read_detections([tmp_path / "found"], log, CLASSES, layout=layout)
    check_boxes(found, labels, 0.006 if layout == "kitti" else 1e-9)
