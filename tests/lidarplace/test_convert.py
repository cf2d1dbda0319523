"""The command: box logs on disk, what it prints, and one line for a mistake."""

import pytest
from argoverse_layout import LEVEL, Log, write_argoverse
from argoverse_layout import Box as ArgoverseBox
from nuscenes_layout import Box, Sample, Scene, write_nuscenes
from typer.testing import CliRunner

from lidarplace.commands.convert import app
from lidarplace.logs.box_log import read_box_log

CATEGORIES = ["vehicle.car", "movable_object.barrier", "vehicle.bus.rigid"]


def convert(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def words(text):
    """Lines as words, without the table's rules."""
    return [line.split() for line in text.splitlines()]


@pytest.fixture
def nuscenes(tmp_path):
    boxes = [Box(name, (9.0, 0.0, 1.0), instance=name) for name in CATEGORIES]
    scenes = [
        Scene(f"scene-{n}", [Sample(5, boxes), Sample(6), Sample(7, boxes[:2])], f"log-{n}")
        for n in range(2)
    ]
    return write_nuscenes(tmp_path / "nuscenes" / "v1.0-mini", scenes, CATEGORIES).parent


def test_nuscenes(tmp_path, nuscenes):
    names = tmp_path / "val.txt"
    names.write_text("scene-1\n")
    result = convert("nuscenes", nuscenes, tmp_path / "log", "--test-scenes", names)
    assert result.exit_code == 0
    log = read_box_log(tmp_path / "log")
    assert log.frames["split"].tolist() == ["train"] * 3 + ["test"] * 3
    lines = words(result.stdout)
    assert ["test", "1", "3", "1", "2"] in lines
    assert ["Car", "4"] in lines
    assert ["Pedestrian", "0"] in lines
    assert ["ignored:", "movable_object.barrier", "4"] in lines
    assert ["ignored:", "vehicle.bus.rigid", "2"] in lines
    assert str(tmp_path / "log") in result.stdout


def test_class_map(tmp_path, nuscenes):
    own = tmp_path / "map.yaml"
    own.write_text("vehicle.bus.rigid: Cyclist  # a van, if a large one\n")
    arguments = ("nuscenes", nuscenes, tmp_path / "log", "--class-map", own, "--test-share", 0.5)
    result = convert(*arguments)
    assert ["Cyclist", "2"] in words(result.stdout)
    assert "bus" not in result.stdout


def test_argoverse(tmp_path):
    poses = {1: (LEVEL, (0.0, 0.0, 0.0))}
    logs = [
        Log(split, split, [ArgoverseBox(1, "BUS", (9.0, 0.0, 1.0))], poses)
        for split in ("train", "val")
    ]
    write_argoverse(tmp_path / "av2", logs)
    result = convert("argoverse", tmp_path / "av2", tmp_path / "log", "--split", "val")
    assert result.exit_code == 0
    assert ["test", "1", "1", "1", "0"] in words(result.stdout)
    assert ["ignored:", "BUS", "1"] in words(result.stdout)
    assert len(read_box_log(tmp_path / "log").boxes) == 0


def test_table(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("frame,class,x,y,z,length,width,height,yaw\n1,Car,9,0,1,4,2,1.5,0\n")
    assert convert("table", path, tmp_path / "log", "--frames", 3).exit_code == 0
    assert read_box_log(tmp_path / "log").frames["frame"].tolist() == [1, 2, 3]
    frames = tmp_path / "all.csv"
    frames.write_text("frame\n0\n1\n")
    assert convert("table", path, tmp_path / "log", "--frames", frames).exit_code == 0
    assert read_box_log(tmp_path / "log").frames["frame"].tolist() == [0, 1]


def test_a_table_with_values_at_the_limits(tmp_path):
    path = tmp_path / "boxes.csv"
    head = "frame,class,x,y,z,length,width,height,yaw\n"
    path.write_text(head + "1,Car,9,0,1,4,2,1.5,-6.3\n2,Car,9,0,1,50,2,1.5,12.5\n")
    assert convert("table", path, tmp_path / "log", "--frames", 9).stderr == ""


def test_a_data_set_of_large_objects_is_converted_with_a_warning(tmp_path):
    poses = {1: (LEVEL, (0.0, 0.0, 0.0))}
    train = ArgoverseBox(1, "REGULAR_VEHICLE", (9.0, 0.0, 1.0), size=(60.0, 2.0, 1.5))
    write_argoverse(tmp_path / "av2", [Log("train", "train", [train], poses)])
    result = convert("argoverse", tmp_path / "av2", tmp_path / "log")
    assert result.exit_code == 0
    assert result.stderr == (
        "warning: sizes are in metres; over 50 m: 1 of 1 boxes (100.0%), the first in frame 0 with "
        "60 x 2 x 1.5\n"
    )


LABEL = "Car 0.00 0 0.00 600.00 170.00 640.00 200.00 1.50 1.80 4.20 0.00 1.65 {z} -1.57"


def test_kitti(tmp_path):
    labels = tmp_path / "kitti" / "training" / "label_2"
    labels.mkdir(parents=True)
    (labels / "000003.txt").write_text(LABEL.format(z="20.00") + "\n")
    (labels / "000004.txt").write_text(LABEL.format(z="nan") + "\n" + LABEL.format(z="9.00") + "\n")
    result = convert("kitti", tmp_path / "kitti", tmp_path / "log")
    assert result.exit_code == 2
    assert "000003.txt: no such file" in result.stderr
    assert "--standard-calibration takes" in result.stderr
    arguments = ("kitti", tmp_path / "kitti", tmp_path / "log", "--standard-calibration")
    result = convert(*arguments)
    assert result.exit_code == 2
    assert "000004.txt: line 1" in result.stderr
    assert not (tmp_path / "log").exists()
    result = convert(*arguments, "--skip-bad")
    assert result.exit_code == 0
    assert ["Car", "2"] in words(result.stdout)
    assert "skipped 1:" in result.stdout
    assert "000004.txt: line 1" in result.stdout
    log = read_box_log(tmp_path / "log")
    assert log.frames["frame"].tolist() == [3, 4]
    assert log.boxes["x"].tolist() == pytest.approx([20.27, 9.27])
