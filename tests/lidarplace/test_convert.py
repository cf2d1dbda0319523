"""The command: box logs on disk, what it prints, and one line for a mistake."""

import numpy as np
import pytest

from lidarplace.clouds.clouds import read_clouds
from lidarplace.commands.convert import app
from lidarplace.logs.box_log import read_box_log
from tests.lidarplace.argoverse_layout import LEVEL, Log, write_argoverse
from tests.lidarplace.argoverse_layout import Box as ArgoverseBox
from tests.lidarplace.nuscenes_layout import Box, Sample, Scene, write_nuscenes
from tests.sweeps.toy import call

CATEGORIES = ["vehicle.car", "movable_object.barrier", "vehicle.bus.rigid"]


def convert(*arguments, code=0):
    return call(app, *arguments, code=code)


def words(text):
    """Lines as words, without the table's rules."""
    return [line.split() for line in text.splitlines()]


def test_nuscenes(tmp_path):
    boxes = [Box(name, (9.0, 0.0, 1.0), instance=name) for name in CATEGORIES]
    samples = [Sample(5, boxes), Sample(6), Sample(7, boxes[:2])]
    scenes = [Scene(f"scene-{n}", samples, f"log-{n}") for n in range(2)]
    nuscenes = write_nuscenes(tmp_path / "nuscenes" / "v1.0-mini", scenes, CATEGORIES).parent
    names = tmp_path / "val.txt"
    names.write_text("scene-1\n")
    result = convert("nuscenes", nuscenes, tmp_path / "log", "--test-scenes", names)
    log = read_box_log(tmp_path / "log")
    assert log.frames["split"].tolist() == ["train"] * 3 + ["test"] * 3
    lines = words(result.stdout)
    ignored = [["ignored:", name, count] for name, count in zip(CATEGORIES[1:], "42", strict=True)]
    for line in (["test", "1", "3", "1", "2"], ["Car", "4"], ["Pedestrian", "0"], *ignored):
        assert line in lines
    assert str(tmp_path / "log") in result.stdout
    own = tmp_path / "map.yaml"
    own.write_text("vehicle.bus.rigid: Cyclist  # a van, if a large one\n")
    result = convert("nuscenes", nuscenes, tmp_path / "log", "--class-map", own)
    assert ["Cyclist", "2"] in words(result.stdout)
    assert "bus" not in result.stdout


def test_argoverse(tmp_path):
    """A bus is ignored, and a large object converted with a warning."""
    poses, at = {1: (LEVEL, (0.0, 0.0, 0.0))}, (9.0, 0.0, 1.0)
    train = ArgoverseBox(1, "REGULAR_VEHICLE", at, size=(60.0, 2.0, 1.5))
    boxes = {"val": ArgoverseBox(1, "BUS", at), "train": train}
    write_argoverse(
        tmp_path / "av2", [Log(name, name, [box], poses) for name, box in boxes.items()]
    )
    result = convert("argoverse", tmp_path / "av2", tmp_path / "log", "--split", "val")
    assert (result.exit_code, result.stderr) == (0, "")
    assert ["test", "1", "1", "1", "0"] in words(result.stdout)
    assert ["ignored:", "BUS", "1"] in words(result.stdout)
    assert len(read_box_log(tmp_path / "log").boxes) == 0
    result = convert("argoverse", tmp_path / "av2", tmp_path / "log")
    assert result.stderr == (
        f"warning: {tmp_path / 'av2'}: column length: sizes are in metres; over 50 m: 1 of 1 boxes "
        "(100.0 %), the first in frame 0 with 60 x 2 x 1.5; check units.size of the source\n"
    )


def test_table(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("frame,class,x,y,z,length,width,height,yaw\n1,Car,9,0,1,4,2,1.5,0\n")
    convert("table", path, tmp_path / "log", "--frames", 3)
    assert read_box_log(tmp_path / "log").frames["frame"].tolist() == [1, 2, 3]
    frames = tmp_path / "all.csv"
    frames.write_text("frame\n0\n1\n")
    convert("table", path, tmp_path / "log", "--frames", frames)
    assert read_box_log(tmp_path / "log").frames["frame"].tolist() == [0, 1]
    with path.open("a") as file:  # values at the limits
        file.write("1,Car,9,0,1,4,2,1.5,-6.3\n1,Car,9,0,1,50,2,1.5,12.5\n")
    assert convert("table", path, tmp_path / "log", "--frames", 9).stderr == ""


def test_readers_have_the_options_that_apply_to_them(tmp_path):
    for reader, option in (
        ("waymo", "--clouds"),
        ("nuscenes", "--rig"),
        ("table", "--keep-ignored"),
    ):
        result = convert(reader, tmp_path, tmp_path / "log", option, tmp_path, code=2)
        assert option in result.stderr


LABEL = "Car 0.00 0 0.00 600.00 170.00 640.00 200.00 1.50 1.80 4.20 0.00 1.65 {z} -1.57"


def test_kitti(tmp_path):
    labels = tmp_path / "kitti" / "training" / "label_2"
    labels.mkdir(parents=True)
    (labels / "000003.txt").write_text(LABEL.format(z="20.00") + "\n")
    (labels / "000004.txt").write_text(LABEL.format(z="nan") + "\n" + LABEL.format(z="9.00") + "\n")
    result = convert("kitti", tmp_path / "kitti", tmp_path / "log", code=2)
    assert "000003.txt: no such file" in result.stderr
    assert "--standard-calibration takes" in result.stderr
    arguments = ("kitti", tmp_path / "kitti", tmp_path / "log", "--standard-calibration")
    result = convert(*arguments, code=2)
    assert "000004.txt: line 1" in result.stderr
    assert not (tmp_path / "log").exists()
    result = convert(*arguments, "--skip-bad")
    assert ["Car", "2"] in words(result.stdout)
    assert "skipped 1:" in result.stdout
    assert "000004.txt: line 1" in result.stdout
    log = read_box_log(tmp_path / "log")
    assert log.frames["frame"].tolist() == [3, 4]
    assert log.boxes["x"].tolist() == pytest.approx([20.27, 9.27])


def kitti_with_cloud(folder, below=1.73):
    """A frame with a car 20 m ahead, its points `below` under the ego frame's ground."""
    (labels := folder / "training" / "label_2").mkdir(parents=True)
    (clouds := folder / "training" / "velodyne").mkdir()
    (labels / "000003.txt").write_text(LABEL.format(z="20.00") + "\n")
    points = [(19.0, -0.2, 0.8 - below, 0.5), (21.0, 0.2, 1.0 - below, 0.5), (9.0, 9.0, 0.0, 0.0)]
    np.array(points, np.float32).tofile(clouds / "000003.bin")
    return folder


def test_points_of_kitti_are_counted_and_kept_where_named(tmp_path):
    source = kitti_with_cloud(tmp_path / "kitti")
    arguments = ("kitti", source, tmp_path / "log", "--standard-calibration")
    result = convert(*arguments)
    log = read_box_log(tmp_path / "log")
    assert log.boxes["points"].tolist() == log.boxes["points/velodyne"].tolist() == [2]
    rig = log.rigs["kitti"].placement
    assert (rig.mounts[0].z, rig.lidars[0].azimuth_steps) == (1.73, 2007)
    assert ["velodyne", "1", "2"] in words(result.stdout)
    assert "real clouds: 1 of 1 frames have one" in result.stdout
    assert "rig: velodyne (1 of 1 scenes)" in result.stdout
    assert not (tmp_path / "log" / "clouds").exists()
    result = convert(*arguments, "--clouds", source, "--lidar", "vlp16")
    assert read_clouds(tmp_path / "log" / "clouds" / "recorded" / "0000").counts.tolist() == [[3]]
    assert read_box_log(tmp_path / "log").rigs["kitti"].placement.lidars[0].beams == 16
    convert(*arguments)
    assert not (tmp_path / "log" / "clouds" / "recorded").exists(), "of the log of before"


def test_labels_are_converted_where_clouds_nobody_named_are_wrong(tmp_path):
    source = kitti_with_cloud(tmp_path / "kitti")
    (source / "training" / "velodyne" / "000003.bin").write_bytes(b"12345")
    arguments = ("kitti", source, tmp_path / "log", "--standard-calibration")
    result = convert(*arguments)
    assert "warning: no points are counted" in result.stderr
    result = convert(*arguments[:2], tmp_path / "other", arguments[-1], "--clouds", source, code=2)
    assert "000003.bin: " in result.stderr
    assert not (tmp_path / "other").exists()


RIG = "mounts: [{name: roof, z: 2.0, lidar: vlp16}, {name: nose, x: 2.0, z: 0.6}]\n"


def test_a_table_with_counts_a_rig_and_uneven_ground(tmp_path):
    path = tmp_path / "boxes.csv"
    head = "frame,class,x,y,z,length,width,height,yaw,points,points/roof\n"
    path.write_text(head + "1,Car,9,0,-0.5,4,2,1.5,0,30,20\n2,Car,9,0,0.75,4,2,1.5,0,,\n")
    (tmp_path / "rig.yaml").write_text(RIG)
    arguments = ("table", path, tmp_path / "log", "--frames", 2)
    result = convert(*arguments, "--rig", tmp_path / "rig.yaml", "--lidar", "hdl32e")
    log = read_box_log(tmp_path / "log")
    assert log.rigs["log"].names == ("roof", "nose")
    assert [lidar.beams for lidar in log.rigs["log"].placement.lidars] == [16, 32]
    assert log.boxes["points/roof"].tolist()[0] == 20
    assert ["all", "1", "30"] in words(result.stdout)
    assert ["train", "2", "1", "1", "0"] in words(result.stdout), "boxes off the ground"
    result = convert(*arguments, "--ground", "level")
    assert "underside more than 0.3 m off the ground: 1 boxes before, 0 after" in result.stdout
    assert "rig: unknown, so these points are compared with no simulation" in result.stdout
    assert read_box_log(tmp_path / "log").boxes["z"].tolist() == [0.75, 0.75]
