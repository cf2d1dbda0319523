"""Each command that a run prints or writes on its pages can be typed as it stands."""

import re
import shlex
import sys
from html import unescape
from pathlib import Path

import pytest
from small_log import SMALL, write_sweep

from lidarplace.command_line.invocation import with_settings
from sweeps.command_line import app
from tests.mlflow_database import write_database
from tests.sweeps.toy import call

DETECT = """
import sys
line = "Car -1 -1 0 100 100 200 200 1.6 1.8 4.4 1 1.7 15 0 0.9"
open(sys.argv[1] + "/000003.txt", "w").write(line)
"""
COMMAND = {"format": "kitti", "command": "{python} detect.py {detections} {clouds}"}
SEEDED = COMMAND | {"command": COMMAND["command"] + " {seed}"}
JUDGES = {
    "command": (COMMAND, False),
    "command with a seed": (SEEDED, True),
    "pretrained": ("pretrained", True),
    "specialist": ("specialist", True),
}
"""And whether more seeds are more evidence."""


def printed(text: str) -> set[str]:
    """Commands in what a terminal shows, or in a page."""
    lines = re.findall(r"lidarplace (?:run|dashboard|studio|search|view) [^\n<`]*", unescape(text))
    return {line.strip().removesuffix('",') for line in lines}


@pytest.mark.parametrize("case", JUDGES)
def test_commands_of_a_sweep_can_be_typed(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_database(tmp_path / "runs/mlflow.db")
    Path("detect.py").write_text(DETECT)
    judge, seeds = JUDGES[case]
    few = {"surrogate": SMALL["surrogate"] | {"names": ["ig"]}, "judge": judge}
    grid = {"placement": ["line", "center"]} | ({"seed": [1]} if seeds else {})
    path = write_sweep(tmp_path, "tiny.yaml", **few, grid=grid)
    words = ["run", str(path), "--set", "training.epochs=1", "--set=training.batch_size=3"]
    monkeypatch.setattr(sys, "argv", ["lidarplace", *words])
    shown = call(app, *words, code=0).output
    pages = [page.read_text() for page in Path("runs/tiny").glob("*.[hm][td]*")]
    lines = set().union(*map(printed, [shown, *pages]))
    more = [line for line in lines if "grid.seed=[1,2,3]" in line]
    assert len(more) == seeds
    assert all(line.count("training.epochs=") == 1 for line in lines if " run " in line)
    for line in lines:
        _, verb, *rest = shlex.split(line)
        if verb == "run":
            call(app, verb, *rest, "--dry-run", code=0)
        else:
            assert Path(rest[0]).exists(), line


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("lidarplace run a", "lidarplace run a --set a.b=[1,2]"),
        ("lidarplace run a --set a.b=3 --set c=4", "lidarplace run a --set c=4 --set a.b=[1,2]"),
        ("lidarplace run 'a b' --set=a.b=3", "lidarplace run 'a b' --set a.b=[1,2]"),
    ],
)
def test_a_setting_replaces_an_earlier_one(line, expected):
    assert shlex.split(with_settings(line, {"a.b": [1, 2]})) == shlex.split(expected)
