"""Detections of other programs: every layout, and what is wrong in one."""

import json
import pickle
import subprocess
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.detections.read import COLUMNS, LAYOUTS, read_detections
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY, SIZE, SOURCE, full_poses
from lidarplace.scenes.datasets import argoverse, waymo
from lidarplace.scenes.datasets.nuscenes import read_nuscenes
from lidarplace.scenes.kitti.calibration import STANDARD, calibration_text
from lidarplace.scenes.kitti.labels import label_lines, to_labels
from tests.lidarplace import nuscenes_layout
from tests.refused import refused
from training.kitti_ap import evaluate_boxes

CLASSES = ("Car", "Cyclist", "Pedestrian")
NAMES = {
    "kitti": dict(zip(CLASSES, CLASSES, strict=True)),
    "nuscenes": {"Car": "car", "Cyclist": "bicycle", "Pedestrian": "pedestrian"},
    "argoverse": {"Car": "REGULAR_VEHICLE", "Cyclist": "BICYCLIST", "Pedestrian": "PEDESTRIAN"},
    "waymo": {"Car": 1, "Cyclist": 4, "Pedestrian": 2},
    "parquet": dict(zip(CLASSES, CLASSES, strict=True)),
}
SOURCES = {
    "kitti": "{:06d}",
    "nuscenes": "{:032x}",
    "argoverse": "log/{}",
    "waymo": "segment/{}",
    "parquet": "drive {}",
}


def log_of(layout: str, frames: int = 30) -> BoxLog:
    """Boxes of three classes around a vehicle that drives a bend uphill; numbers of two digits."""
    random = np.random.default_rng(7)
    times = np.arange(frames)
    table = pd.DataFrame({"scene": "s", "frame": times, "timestamp_s": 0.1 * times})
    table = table.assign(route=times // 10, split="test")
    table = table.assign(ego_x=1000.0 + 2 * times, ego_y=500.0 - times, ego_yaw=0.02 * times)
    roll, pitch = 0.01 * np.sin(times), -0.02 * np.cos(times)
    table = table.assign(ego_z=0.1 * times, ego_roll=roll, ego_pitch=pitch)
    numbers = times + 1000 * (layout == "waymo")
    table[SOURCE] = [SOURCES[layout].format(number) for number in numbers]
    rows = []
    for time in times.tolist():
        for number, name in enumerate(CLASSES * 2):
            place = [6.0 + 5 * number, random.uniform(-9, 9), 0.9]
            size = np.round(random.uniform([3.0, 1.0, 1.4], [5.0, 2.0, 1.9]), 2)
            yaw = random.uniform(-3, 3)
            rows.append(("s", time, 0.1 * time, f"{number}", name, *place, *size, yaw))
    boxes = pd.DataFrame(rows, columns=list(BOX_COLUMNS))
    return BoxLog(boxes.round(dict.fromkeys(GEOMETRY, 2)), table)


def in_world(log: BoxLog, boxes: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Centres, and rotations as w, x, y, z, of boxes in the world."""
    poses = full_poses(log.frames)
    turns = Rotation.from_matrix([poses[frame][0] for frame in boxes["frame"]])
    at = np.array([poses[frame][1] for frame in boxes["frame"]])
    centre = turns.apply(boxes[[*"xyz"]].to_numpy(copy=True)) + at
    turned = turns * Rotation.from_euler("z", boxes[["yaw"]].to_numpy(copy=True))
    return centre, turned.as_quat()[:, [3, 0, 1, 2]]


def write(layout, path, log, boxes):
    """Write boxes with scores as detections; returns the path."""
    source = boxes["frame"].map(log.frames.set_index("frame")[SOURCE])
    names = boxes["class"].map(NAMES[layout])
    if layout == "kitti":
        path.mkdir()
        (path / "._of_macos.txt").write_bytes(b"\0")
        labels = to_labels(boxes.assign(occluded=0))
        lines = np.array(label_lines(labels), object) + [f" {s!r}" for s in boxes["score"].tolist()]
        for frame, of_frame in pd.Series(lines).groupby(source.to_numpy()):
            (path / f"{frame}.txt").write_text("".join(f"{line}\n" for line in of_frame))
        return path
    if layout == "nuscenes":
        centre, turned = in_world(log, boxes)
        results = {token: [] for token in log.frames[SOURCE]}
        size = boxes[["width", "length", "height"]].to_numpy()
        columns = (source, *(a.tolist() for a in (centre, size, turned)), names, boxes["score"])
        keys = ("sample_token", "translation", "size", "rotation", "detection_name")
        for row in zip(*columns, strict=True):
            box = dict(zip((*keys, "detection_score"), row, strict=True))
            results[row[0]].append(box | {"attribute_name": ""})
        path = path.with_suffix(".json")
        path.write_text(json.dumps({"meta": {"use_lidar": True}, "results": results}))
        return path
    if layout == "argoverse":
        turned = Rotation.from_euler("z", boxes[["yaw"]].to_numpy()).as_quat()[:, [3, 0, 1, 2]]
        columns = dict(zip(argoverse.QUATERNION, turned.T, strict=True))
        centre = boxes[[*"xyz"]].to_numpy() + argoverse.ORIGIN
        columns |= dict(zip(argoverse.TRANSLATION, centre.T, strict=True))
        columns |= dict(zip(argoverse.SIZE, boxes[list(SIZE)].to_numpy().T, strict=True))
        log_id, time = source.str.split("/", expand=True).T.to_numpy()
        columns |= {"log_id": log_id, "timestamp_ns": time.astype(np.int64), "category": names}
        path = path.with_suffix(".feather")
        pd.DataFrame(columns | {"score": boxes["score"]}).to_feather(path)
        return path
    path = path.with_suffix(".parquet")
    if layout == "waymo":
        centre = boxes[[*"xyz"]].to_numpy() + waymo.ORIGIN
        columns = dict(zip(waymo.CENTRE, centre.T, strict=True))
        columns |= dict(zip(waymo.SIZE, boxes[list(SIZE)].to_numpy().T, strict=True))
        segment, time = source.str.split("/", expand=True).T.to_numpy()
        columns |= {waymo.SEGMENT: segment, waymo.TIME: time.astype(np.int64), waymo.TYPE: names}
        columns |= {waymo.HEADING: boxes["yaw"], "score": boxes["score"]}
        pd.DataFrame(columns).to_parquet(path)
        return path
    boxes[list(COLUMNS)].to_parquet(path)
    return path


def scored(boxes: pd.DataFrame) -> pd.DataFrame:
    return boxes.assign(score=np.random.default_rng(1).uniform(0.1, 1, len(boxes)))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_labels_fed_back_are_perfect_and_jittered_ones_as_kitti_ap_has_them(layout, tmp_path):
    log = log_of(layout)
    frames = log.frames["frame"].tolist()
    path = write(layout, tmp_path / "labels", log, scored(log.boxes))
    detections = read_detections([path], log, CLASSES)
    table = evaluate_boxes(log.boxes, detections, frames, CLASSES)
    assert len(detections) == len(log.boxes)
    assert tuple(detections.columns) == COLUMNS
    assert (table.loc[table["metric"] != "mean_overlap", "value"] == 100).all()
    random = np.random.default_rng(3)
    moved = scored(log.boxes[random.uniform(size=len(log.boxes)) < 0.8])
    moved[[*"xy"]] += random.normal(0, 0.15, (len(moved), 2)).round(2)
    detections = read_detections([write(layout, tmp_path / "found", log, moved)], log, CLASSES)
    # As KITTI's files hold it, numbers have two decimals and boxes stand upright.
    assert detections[list(GEOMETRY)].to_numpy() == pytest.approx(
        moved[list(GEOMETRY)].to_numpy(), abs=0.011 if layout == "kitti" else 1e-3
    )
    direct, read = (
        evaluate_boxes(log.boxes, table_of, frames, CLASSES) for table_of in (moved, detections)
    )
    assert 20 < direct.query("metric == 'AP_R40_3D'")["value"].mean() < 80
    of_one_iou = direct["metric"] != "mean_overlap"
    if layout != "kitti":
        assert read[of_one_iou].equals(direct[of_one_iou])


def test_a_table_in_the_world(tmp_path):
    log = log_of("parquet")
    boxes = scored(log.boxes)
    level = replace(log, frames=log.frames.drop(columns=["ego_z", "ego_roll", "ego_pitch"]))
    centre, _ = in_world(level, boxes)
    turned = boxes["yaw"] + boxes["frame"].map(level.frames.set_index("frame")["ego_yaw"])
    in_table = boxes.assign(**dict(zip("xyz", centre.T, strict=True)), yaw=turned)
    source = in_table.pop("frame").map(log.frames.set_index("frame")[SOURCE])
    in_table.assign(source=source).to_parquet(tmp_path / "found.parquet")
    detections = read_detections([tmp_path / "found.parquet"], level, CLASSES, world=True)
    assert detections[list("xyz")].to_numpy() == pytest.approx(boxes[list("xyz")].to_numpy())
    turn = (detections["yaw"] - boxes["yaw"].to_numpy()).to_numpy()
    assert np.exp(1j * turn) == pytest.approx(1)
    without = replace(level, frames=level.frames.drop(columns=["ego_x"]))
    with refused(("row 0", "frame", "0")):
        read_detections([tmp_path / "found.parquet"], without, CLASSES, world=True)


def test_calib_files_place_the_camera(tmp_path):
    log = log_of("kitti", 2)
    path = write("kitti", tmp_path / "found", log, scored(log.boxes))
    (tmp_path / "calib").mkdir()
    ahead = {**STANDARD, "Tr_velo_to_cam": STANDARD["Tr_velo_to_cam"] - [0, 0, 0, 1.0]}
    for stem in log.frames[SOURCE]:
        (tmp_path / "calib" / f"{stem}.txt").write_text(calibration_text(ahead))
    usual, moved = (
        read_detections([path], log, CLASSES, calibration=folder)
        for folder in (None, tmp_path / "calib")
    )
    assert (moved[[*"xyz"]] - usual[[*"xyz"]]).mean().tolist() == pytest.approx([1, -1, -1])
    (tmp_path / "calib" / "000001.txt").unlink()
    with pytest.raises(InputError, match=r"calib/000001\.txt"):
        read_detections([path], log, CLASSES, calibration=tmp_path / "calib")


def test_known_names_without_class_are_counted(tmp_path):
    log, path = log_of("kitti", 1), tmp_path / "000000.txt"
    numbers = "-1 -1 -10 0 0 10 10 1.5 1.6 4 1 1.7 20 0.1 0.9"
    names = ("Car", "Van", "Tram", "DontCare", "Pedestrian")
    path.write_text("".join(f"{name} {numbers}\n" for name in names))
    ignored = Counter()
    detections = read_detections([path], log, ["Car"], ignored=ignored)
    assert detections["class"].tolist() == ["Car", "Car"]
    assert ignored == {"Tram": 1, "DontCare": 1, "Pedestrian": 1}
    mapped = read_detections([path], log, ["Car", "Van", "Lorry"], class_map={"Tram": "Lorry"})
    assert mapped["class"].tolist() == ["Car", "Van", "Lorry"]


GOOD = {"frame": [3, 4], "class": "Car", **dict.fromkeys(GEOMETRY, 1.0), "score": [0.5, 0.6]}


def test_the_line_that_converts_a_pickle_works(tmp_path):
    path = tmp_path / "result.pkl"
    boxes = np.array([[10.0, 1.0, -0.9, 4.0, 1.7, 1.5, 0.1]])
    frame = {"frame_id": "000003", "name": np.array(["Car"]), "score": np.array([0.7])}
    none = {"frame_id": "000004", "name": np.array([]), "score": np.array([])}
    empty = none | {"boxes_lidar": np.zeros((0, 7))}
    path.write_bytes(pickle.dumps([frame | {"boxes_lidar": boxes}, empty]))
    with pytest.raises(InputError) as caught:
        read_detections([path], log_of("kitti"), CLASSES)
    line = caught.value.fix.partition(": ")[2].replace("python", sys.executable, 1)
    subprocess.run(line, shell=True, check=True)
    converted = read_detections([tmp_path / "result.parquet"], log_of("kitti"), CLASSES)
    assert converted.to_numpy().tolist() == [[3, "Car", 10.0, 1.0, 0.83, 4.0, 1.7, 1.5, 0.1, 0.7]]


def test_frames_keep_their_names_on_disk(tmp_path):
    log = log_of("argoverse", 3)
    write_box_log(tmp_path, log)
    assert read_box_log(tmp_path).frames[SOURCE].tolist() == ["log/0", "log/1", "log/2"]
    twice = replace(log, frames=log.frames.assign(source="a"))
    with refused(("log", "source", "a")):
        read_detections([write("parquet", tmp_path / "f", log, scored(log.boxes))], twice, CLASSES)


def test_annotations_of_nuscenes_are_its_detections(tmp_path):
    north = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    box = nuscenes_layout.Box("vehicle.car", (99.0, 210.0, 0.9), (1.9, 4.6, 1.7), north)
    sample = nuscenes_layout.Sample(1_000_000, [box], (100.0, 200.0, 0.5), north)
    scene = nuscenes_layout.Scene("scene-0061", [sample])
    folder = nuscenes_layout.write_nuscenes(tmp_path / "v1.0-mini", [scene], ["vehicle.car"])
    log = read_nuscenes(folder)
    (row,) = json.loads((folder / "sample_annotation.json").read_text())
    row |= {"detection_name": "car", "detection_score": 0.5}
    (tmp_path / "found.json").write_text(json.dumps({"results": {row["sample_token"]: [row]}}))
    detections = read_detections([tmp_path / "found.json"], log, CLASSES)
    assert detections[list(GEOMETRY)].to_numpy() == pytest.approx(
        log.boxes[list(GEOMETRY)].to_numpy()
    )
