"""KITTI-format folders as box logs and clouds."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import PointClouds
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import CLASSES, GEOMETRY
from lidarplace.scenes.datasets.class_maps import OwnNames
from lidarplace.scenes.kitti.calibration import STANDARD, calibration_text
from lidarplace.scenes.kitti.labels import label_lines, to_labels
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds
from lidarplace.scenes.kitti.write import write_kitti
from tests.fuzz.mutate_bytes import NO_FILES

CAR = "Car 0.00 1 -1.67 537.41 181.87 681.71 321.67 1.50 1.60 4.00 1.00 1.65 9.73 -1.57"
CROP = (-40.0, -40.0, 0.0, 40.0, 40.0, 4.0)


def folder_of(path: Path, labels: dict[str, str], calibration: str | None = None) -> Path:
    """A folder of labels and calibrations, without a cloud."""
    text = calibration_text() if calibration is None else calibration
    for name in ("label_2", "calib"):
        (path / "training" / name).mkdir(parents=True)
    for stem, lines in labels.items():
        (path / "training" / "label_2" / f"{stem}.txt").write_text(lines)
        (path / "training" / "calib" / f"{stem}.txt").write_text(text)
    return path


def named_or_skipped(root: Path) -> tuple[BoxLog, list[str]]:
    """The log without what is wrong in the folder, and the lines of it; the first is an error."""
    with pytest.raises(InputError) as error:
        read_kitti(root)
    skipped: list[str] = []
    log = read_kitti(root, skipped=skipped)
    assert skipped[0] == str(error.value)
    return log, skipped


def test_boxes_of_hand_computed_labels(tmp_path) -> None:
    root = folder_of(tmp_path / "kitti", {"000004": f"{CAR}\n", "000009": ""})
    log = read_kitti(root)
    frames = log.frames[["scene", "frame", "split"]].values.tolist()
    assert frames == [["kitti", 4, "train"], ["kitti", 9, "train"]]
    box = log.boxes.iloc[0]
    assert (len(log.boxes), box["class"], box["frame"]) == (1, "Car", 4)
    # The camera is 0.27 m before the LiDAR and 1.73 - 0.08 m above the ground.
    expected = [10, -1, 0.75, 4, 1.6, 1.5, 1.57 - np.pi / 2]
    np.testing.assert_allclose(box[list(GEOMETRY)].to_numpy(float), expected, atol=1e-9)
    none = read_kitti(folder_of(tmp_path / "none", {"000004": ""}))
    assert (len(none.boxes), none.frames["frame"].tolist()) == (0, [4])
    for own in (log, none):
        write_box_log(tmp_path / "log", own)
        again = read_box_log(tmp_path / "log")
        pd.testing.assert_frame_equal(again.boxes, own.boxes, check_dtype=False)
        assert again.frames["frame"].tolist() == own.frames["frame"].tolist()


def rotation(axis: str, angle: float) -> np.ndarray:
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn


@pytest.mark.parametrize("tilt", [0.0, 0.02])
def test_calibration_turns_and_moves_the_boxes(tmp_path, tilt) -> None:
    """Corners computed in the camera frame and moved one by one agree with those of the box."""
    calibration = dict(STANDARD)
    calibration["R0_rect"] = rotation("x", tilt) @ rotation("y", 0.3)
    to_camera = STANDARD["Tr_velo_to_cam"].copy()
    to_camera[:, :3] = to_camera[:, :3] @ rotation("z", -0.1)
    to_camera[:, 3] = [0.2, -0.1, -0.4]
    calibration["Tr_velo_to_cam"] = to_camera
    root = folder_of(tmp_path, {"000000": CAR}, calibration_text(calibration))
    box = read_kitti(root, lidar_height=2.0).boxes.iloc[0]
    height, width, length, x, y, z, turn = map(float, CAR.split()[8:])
    moved, expected = [], []
    for i, j, k in np.ndindex(2, 2, 2):
        along, across, up = (i - 0.5) * length, (j - 0.5) * width, k * height
        corner = np.array([x, y - up, z]) + rotation("y", turn) @ [along, 0.0, across]
        rectified = np.linalg.solve(calibration["R0_rect"], corner) - to_camera[:, 3]
        moved.append(np.linalg.solve(to_camera[:, :3], rectified) + np.array([0, 0, 2.0]))
        local = [along, across, (k - 0.5) * box["height"]]
        expected.append(rotation("z", box["yaw"]) @ local + box[["x", "y", "z"]].to_numpy(float))
    np.testing.assert_allclose(np.mean(moved, 0), np.mean(expected, 0), atol=1e-9)
    np.testing.assert_allclose(moved, expected, atol=1e-9 + 1.5 * length * tilt)


finite = st.floats(-80, 80)
geometry = (finite, finite, st.floats(-3, 5), st.floats(0, 15), st.floats(0, 4), st.floats(0, 5))
box = st.tuples(st.sampled_from(CLASSES), *geometry, st.floats(-7, 7), st.integers(0, 3))
boxes_of_a_frame = st.lists(box, max_size=5)


@settings(derandomize=True, max_examples=25)
@given(st.lists(st.tuples(boxes_of_a_frame, st.booleans()), min_size=1, max_size=4))
def test_round_trip_is_exact_to_the_decimals(tmp_path_factory, drawn) -> None:
    root = tmp_path_factory.mktemp("kitti") / "out"
    names = ["frame", "class", *GEOMETRY, "occluded"]
    rows = [(3 * f, *box) for f, (boxes, _) in enumerate(drawn) for box in boxes]
    objects = pd.DataFrame(rows, columns=names).astype({"frame": np.int64})
    splits = ["test" if test else "train" for _, test in drawn]
    frames = pd.DataFrame({"frame": 3 * np.arange(len(drawn)), "split": splits})
    labels = to_labels(objects)
    empty = [(np.zeros((0, 4), np.float32), [0])] * len(frames)
    clouds = PointClouds.from_frames(frames["frame"], empty, CROP)
    write_kitti(root, frames, [(labels, clouds)])
    log = read_kitti(root)
    pd.testing.assert_frame_equal(log.frames[["frame", "split"]], frames)
    assert log.boxes["frame"].tolist() == objects["frame"].tolist()
    assert log.boxes["class"].tolist() == objects["class"].tolist()
    assert log.boxes["object_id"].is_unique
    half = 0.005 + 1e-9
    for name in GEOMETRY:
        error = np.abs(log.boxes[name].to_numpy() - objects[name].to_numpy(float))
        if name == "yaw":
            error = np.abs(np.mod(error + np.pi, 2 * np.pi) - np.pi)
        # z is of the centre; the format has the bottom and the height.
        assert (error <= (1.5 * half if name == "z" else half)).all(), name
    # What was rounded once is written again to the letter.
    again = to_labels(log.boxes.assign(occluded=objects["occluded"].to_numpy()))
    assert label_lines(again) == label_lines(labels)


def test_types_and_class_map(tmp_path) -> None:
    lines = [CAR.replace("Car", name) for name in ("Van", "Truck", "Person_sitting", "Tram", "Bus")]
    lines += ["DontCare -1 -1 -10 500.00 170.00 590.00 190.00 -1 -1 -1 -1000 -1000 -1000 -10"]
    root = folder_of(tmp_path, {"000000": "\n".join(lines) + "\n\n"})
    ignored: Counter[str] = Counter()
    log = read_kitti(root, class_map={"Bus": "ignore", "Van": "Cyclist"}, ignored=ignored)
    assert log.boxes["class"].tolist() == ["Cyclist", "Cyclist", "Pedestrian"]
    assert ignored == {"Tram": 1, "Bus": 1, "DontCare": 1}
    log = read_kitti(root, class_map={"Bus": "Coach"})
    assert log.boxes["class"].tolist() == ["Car", "Cyclist", "Pedestrian", "Coach"]
    log = read_kitti(root, class_map=OwnNames())
    assert log.boxes["class"].tolist() == ["Van", "Truck", "Person_sitting", "Tram", "Bus"]


def test_image_sets_choose_and_split(tmp_path) -> None:
    root = folder_of(tmp_path, {f"00000{i}": CAR for i in range(5)})
    (root / "ImageSets").mkdir()
    (root / "ImageSets" / "train.txt").write_text("000003\n000000\n\n")
    (root / "ImageSets" / "val.txt").write_text("000002")
    (root / "ImageSets" / "test.txt").write_text("000077")
    for folder in (root, root / "training"):  # whose lists are next to it
        frames = read_kitti(folder).frames[["frame", "route", "split"]].values.tolist()
        assert frames == [[0, 0, "train"], [2, 1, "test"], [3, 0, "train"]]
    (root / "ImageSets" / "val.txt").write_text("000002\n7\n000008\n000003\n")
    log, skipped = named_or_skipped(root)
    assert len(log.frames) == 3
    for fault, message in zip(("2: .*found 7", "3: .*8.txt", "4: .*000003"), skipped, strict=True):
        assert re.search(rf"val\.txt: line {fault}", message)


@pytest.mark.parametrize("name", ["ImageSets", "ImageSets/train.txt"])
@pytest.mark.parametrize("what", NO_FILES)
def test_a_list_that_cannot_be_read_drops_no_split(tmp_path, name, what) -> None:
    root = folder_of(tmp_path, {"000000": CAR, "000001": CAR})
    if name == "ImageSets" and "folder" in what:
        pytest.skip("a folder of lists")
    if name != "ImageSets":
        (root / "ImageSets").mkdir()
        (root / "ImageSets/val.txt").write_text("000001\n")
    NO_FILES[what](root / name)
    with pytest.raises(OSError, match=name):
        read_kitti(root)


def test_labels_alone_are_enough_if_asked_for(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match="label_2"):
        read_kitti(tmp_path)
    (tmp_path / "label_2").mkdir()
    (tmp_path / "label_2" / "000012.txt").write_text(CAR)
    box = read_kitti(tmp_path, standard_calibration=True).boxes.iloc[0]
    assert box[["x", "y", "z"]].tolist() == pytest.approx([10, -1, 0.75])


@pytest.mark.parametrize(
    ("name", "text", "boxes"),
    [
        ("label_2/000001.txt", f"{CAR} 0.9\n{CAR} 0.9 1\n{CAR}\n", [0, 1, 1]),
        ("label_2/1.txt", CAR, [0, 1]),
        ("calib/000001.txt", "", [0]),
        ("calib/000001.txt", calibration_text({**STANDARD, "R0_rect": np.zeros((3, 3))}), [0]),
    ],
)
def test_what_is_broken_is_named_or_skipped(tmp_path, name, text, boxes) -> None:
    root = folder_of(tmp_path, {"000000": CAR, "000001": CAR})
    (root / "training" / name).write_text(text)
    log, (line,) = named_or_skipped(root)
    assert name in line
    assert log.boxes["frame"].tolist() == boxes
    assert log.frames["frame"].tolist() == sorted(set(boxes))


def test_names_of_other_layouts_are_understood(tmp_path) -> None:
    text = calibration_text().replace("R0_rect:", "R_rect")
    text = text.replace("Tr_velo_to_cam:", "Tr_velo_cam ")
    root = folder_of(tmp_path / "a", {"000000": CAR}, text + "S_rect_02: 1242 375\n")
    first = read_kitti(root).boxes[list(GEOMETRY)]
    plain = read_kitti(folder_of(tmp_path / "b", {"000000": CAR})).boxes[list(GEOMETRY)]
    pd.testing.assert_frame_equal(first, plain)


def write_bin(root: Path, frame: int, points: np.ndarray) -> Path:
    path = root / "velodyne" / f"{frame:06d}.bin"
    path.parent.mkdir(exist_ok=True)
    points.astype("<f4").tofile(path)
    return path


def test_clouds_round_trip(tmp_path) -> None:
    rng = np.random.default_rng(1)
    cloud = np.c_[rng.uniform(CROP[:3], CROP[3:], (500, 3)), rng.uniform(0, 1, 500)]
    cloud[:50, 2], cloud[50:60, 2], cloud[60:70, 0] = 0.0, 4.0, 40.0  # on faces of the region
    clouds = PointClouds.from_frames([2, 5], [(cloud.astype(np.float32), [500])] * 2, CROP)
    labels = to_labels(pd.DataFrame(columns=["frame", "class", *GEOMETRY, "occluded"]))
    frames = pd.DataFrame({"frame": [2, 5], "split": "train"})
    write_kitti(tmp_path / "out", frames, [(labels, clouds)])
    back = read_kitti_clouds(tmp_path / "out", [5, 2], CROP)
    assert back.frames.tolist() == [5, 2]
    np.testing.assert_allclose(back[0], clouds[1], atol=1e-6)
    assert back.counts.tolist() == [[500], [500]]


def test_clouds_are_cut_and_lifted(tmp_path) -> None:
    write_bin(tmp_path, 0, np.array([[1, 2, -1.5, 0.5], [1, 2, -1.8, 0.5], [50, 2, -1, 0.5]]))
    write_bin(tmp_path, 1, np.empty((0, 4)))
    clouds = read_kitti_clouds(tmp_path, [0, 1], CROP, lidar_height=1.6)
    np.testing.assert_allclose(clouds[0], [[1, 2, 0.1, 0.5]], atol=2e-3)
    assert len(clouds[1]) == 0


def test_bad_points_and_files_are_skipped(tmp_path) -> None:
    path = write_bin(tmp_path, 3, np.zeros((2, 4)))
    path.write_bytes(path.read_bytes()[:-3])
    good = [1.0, 2.0, 1.0, 0.5]
    write_bin(tmp_path, 4, np.array([good, [np.nan, *good[1:]], [*good[:3], np.inf], good]))
    write_bin(tmp_path, 5, np.array([[1, 2, 3, 200.0]]))
    skipped: list[str] = []
    clouds = read_kitti_clouds(tmp_path, [1, 3, 4, 5], CROP, skipped=skipped)
    assert clouds.frames.tolist() == [4, 5]
    assert ([len(cloud) for cloud in clouds], len(skipped)) == ([2, 0], 5)
