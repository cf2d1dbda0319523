"""A reader of a data set is two files, as docs/extending.md has them."""

import json

from lidarplace.logs.box_log import read_box_log
from tests.extending import blocks_of, check_layers, copy_tree, put, python

PROGRAM = "from sweeps.command_line import app; app()"


def test_a_reader_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    reader, lines = blocks_of("A reader of a data set")
    imported, command = lines.split("\n\n", 1)
    convert = tree / "lidarplace/commands/convert.py"
    (tree / "lidarplace/scenes/datasets/json_lines.py").write_text(reader, encoding="utf-8")
    put(convert, "from lidarplace.scenes.datasets.nuscenes import", f"{imported}\n")
    put(convert, "def _convert(", f"{command}\n\n")

    car = {"class": "Car", "object_id": "7", "x": 9.0, "y": 0.0, "z": 0.8}
    car |= {"length": 4.0, "width": 2.0, "height": 1.6, "yaw": 0.0}
    frames = [[car, car | {"class": "Tram"}], *([[]] * 9)]
    text = "\n".join(json.dumps(frame) for frame in frames)
    (tree / "boxes.json").write_text(text, encoding="utf-8")
    told = python(tree, "-c", PROGRAM, "convert", "json-lines", "boxes.json", "log")
    assert "Tram" in told
    log = read_box_log(tree / "log")
    assert log.frames["split"].tolist() == ["train"] * 9 + ["test"]
    assert log.boxes[["frame", "class", "x"]].to_numpy().tolist() == [[0, "Car", 9.0]]

    (tree / "boxes.json").write_text("[", encoding="utf-8")
    wrong = ("-m", "lidarplace.commands.convert", "json-lines", "boxes.json", "log")
    assert len(python(tree, *wrong, code=2).splitlines()) == 1
    check_layers(tree)
