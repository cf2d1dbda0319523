"""Thirty mistakes of a new user, in settings and in data, and the line that each prints."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from sweeps.command_line import app
from tests.docs_blocks import ROOT
from tests.sweeps.small_log import write_small_log

GRID, SEARCH = "examples/grid.yaml", "examples/search.yaml"
PLACEMENTS = "line, center, trapezoid, square, line_roll, pyramid, pyramid_roll, pyramid_pitch"

SETTINGS = {
    "search.objective=recal": "search.objective[0].by: found 'recal' (did you mean recall?); "
    "should be 's_mig', 'ig', 'h_pog', 'covered_entropy', 'residual_entropy', 'm_sog', "
    "'expected_points', 'expected_ig', 'expected_recall', 'AP_R40_3D', 'AP_R40_BEV', "
    "'AP_R40_3D_mean', 'recall', 'mean_overlap', 'price', 'power' or 'margin'",
    "search.objective=generalist.recall.car": "search.objective: generalist.recall.car: car is "
    "none of the classes Car, Cyclist (did you mean Car?)",
    "search.zones.roof.x=[1,0]": "search.zones.roof.x: found [1, 0]; allowed is a number, or "
    "[min, max] with min <= max",
    "search.sampler=tpee": "search.sampler: found 'tpee' (did you mean tpe?); should be 'tpe', "
    "'gp', 'cmaes', 'nsga2', 'nsga3', 'random' or 'qmc'",
    "classes=[Cars]": "classes: found ['Cars']; simulated traffic has no Cars (did you mean Car?); "
    "it has Car, Cyclist, Pedestrian",
    "classes=Car": "classes: found 'Car'; should be a list, such as [Car]",
    "judge=generalst": "judge: found 'generalst' (did you mean generalist?); should be "
    "'specialist', 'generalist' or 'finetuned'",
    "grid.placement=[lines]": "grid.placement: no placement 'lines' (did you mean line?); allowed "
    f"are {PLACEMENTS}, corners",
    "lidar=VLP-61": "lidar: no LiDAR is called 'VLP-61'; did you mean vlp16?",
    "lidar.azimuth_deg=[10,5]": "lidar.azimuth_deg: found [10, 5]; allowed is [min, max] with "
    "min < max and max - min <= 360",
    "placements.mine.mounts=[{x: 0, y: 0}]": "placements.mine.mounts[0].z: is missing",
    "placements.mine.mounts=[{z: 2, yaw: 45}]": "placements.mine.mounts[0].yaw: found 45; should "
    "be less than or equal to 6.2832 radians",
    "placements.mine.mounts=[{z: 2}, {z: 2}]": "placements: placement 'mine': LiDARs 0 and 1 are "
    "both at (0, 0, 2); two LiDARs cannot sit in one place",
    "roi.x=[40,0]": "roi.x: found [40, 0]; allowed is [min, max] with min < max",
    "roi.resolution=0.1": "roi.resolution: unknown key; allowed are x, y, z",
    "training.epochs=0": "training.epochs: found 0; should be greater than or equal to 1",
    "scene={source: log, folder: nowhere}": "scene.folder: found 'nowhere'; "
    "nowhere/frames.parquet: no such file",
}
"""The line, behind the name of the file, by what `--set` puts into the example."""

LABELS = "examples/labels/labels.csv"
COLUMNS = "recording, stamp, track, kind, posX, posY, posZ, len, wid, hgt, heading"

MAPPINGS = {
    "units.angle: rad": f"{LABELS}: column heading: yaw is in radians; over two turns: 491 of 646 "
    "boxes (76.0%), the first in frame 0 with 77; mend units.angle of the mapping; if it is meant: "
    "accept: [yaw]",
    "units.angle: degree": "map.yaml: units.angle: found 'degree' (did you mean deg?); should be "
    "'rad' or 'deg'",
    "units.size: m": f"{LABELS}: column len: sizes are in metres; over 50 m: 646 of 646 boxes "
    "(100.0%), the first in frame 0 with 1859 x 536 x 1646; mend units.size of the mapping; if it "
    "is meant: accept: [size]",
    "units.time: ms": f"{LABELS}: column stamp: from one frame with boxes to the next it is 500 s "
    "in the median: 646 of 646 boxes (100.0%), the first in frame 0 with 0; mend units.time, or "
    "frames.rate_hz of the mapping; if it is meant: accept: [time]",
    "columns.x: posx": f"{LABELS}: columns.x: no column 'posx'; found {COLUMNS}",
    "classes.lorry: Tr uck": "map.yaml: classes.lorry: a class has a name of letters, digits, _, - "
    "and ., at most 64, found 'Tr uck'; null leaves its boxes out",
    "origin.z: 5.0": f"{LABELS}: column posZ: the undersides of near boxes are +4.67 m off the "
    "ground in the median: 571 of 646 boxes (88.4%), the first in frame 0 with 5.49; mend "
    "origin.z, -4.67 m from what it is, or units.position of the mapping; if it is meant: "
    "accept: [ground]",
    "drives.test: [monday]": f"{LABELS}: drives.test: no drive 'monday' in column recording; "
    "found 2026-03-02_01, 2026-03-02_02, 2026-03-04_01",
    "frames.rate_hz: 3.0": f"{LABELS}: column stamp: 95.1% of the rows of a drive lie more than a "
    "quarter of a frame off a rate of 3 Hz, the first with 1760000000500000; mend frames.rate_hz "
    "or units.time",
}
"""The line by what is changed in the mapping of the label file of the examples."""

FILES = {
    "convert table log/boxes.parquet out --frames 2": "log/boxes.parquet: has boxes of 4 frames, "
    "more than 2",
    "describe nothing": "nothing/boxes.parquet: no such file",
    "view log --frame 999": "log: no frame 999; the log has 4 frames, 0 to 3",
    "export log out --placement lines": "--placement lines (did you mean line?): allowed are "
    f"{PLACEMENTS} and a FILE.yaml",
}
"""The line by the command."""


@pytest.fixture(autouse=True)
def world(tmp_path, monkeypatch) -> Path:
    """A folder with the examples and a small log."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    write_small_log(tmp_path / "log")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def line_of(*words: str) -> str:
    """What is told on stderr, which is one line, with exit code 2."""
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    return done.stderr.strip()


def test_there_are_thirty():
    assert len(SETTINGS) + len(MAPPINGS) + len(FILES) == 30


@pytest.mark.parametrize("pair", SETTINGS)
def test_settings(pair):
    verb, file = ("search", SEARCH) if pair.startswith("search.") else ("run", GRID)
    assert line_of(verb, file, "--dry-run", "--set", pair) == f"{file}: {SETTINGS[pair]}"


@pytest.mark.parametrize("change", MAPPINGS)
def test_mappings(change, world):
    mapping = yaml.safe_load((world / "examples/labels/map.yaml").read_text("utf-8"))
    key, value = yaml.safe_load(change).popitem()
    section, name = key.split(".")
    mapping[section][name] = value
    (world / "map.yaml").write_text(yaml.safe_dump(mapping))
    assert line_of("convert", "table", LABELS, "out", "--mapping", "map.yaml") == MAPPINGS[change]
    assert not (world / "out").exists()


@pytest.mark.parametrize("command", FILES)
def test_files(command):
    assert line_of(*command.split()) == FILES[command]
