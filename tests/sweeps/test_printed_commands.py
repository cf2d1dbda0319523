"""Every command that a run prints, in a terminal or on its pages, is taken as it stands."""

import html
import re
import shlex
import sys
from pathlib import Path
from unittest.mock import patch

import pytest
import yaml

from sweeps.command_line import app
from tests.fuzz.lines import ACCEPTED, LINES
from tests.mlflow_database import write_database
from tests.sweeps.search_files import SEARCH
from tests.sweeps.small_log import SMALL, write_small_log
from tests.sweeps.test_command_evaluator import TOY
from tests.sweeps.toy import call

SWEEP = SMALL | {"lidar": {"azimuth_steps": 90}, "detector": "pointpillars_tiny"}
SWEEP |= {"surrogate": SMALL["surrogate"] | {"names": ["ig"]}}
SWEEP |= {"grid": {"placement": ["line", "center"], "seed": [1]}, "ray": "debug"}
TRAINED = "--set training.epochs=1 --set training.lr=0.002"
FEW = {"rigs": 2, "rigs_per_frame": 1, "epochs": 1}
JUDGE = {"command": "{python} toy.py {clouds} {detections}", "format": "kitti", "name": "toy"}
NO_SEED = {"grid": {"placement": ["line", "center"]}, "evaluator": JUDGE}
LOG = {"scene": {"source": "log", "folder": "log"}}
CAR = "Car -1 -1 -10 100 100 200 200 1.6 1.8 4.4 0.0 1.6 15.0 0.0 0.9\n"
CASES = {
    "detectors": ("run", SWEEP, TRAINED, {"run", "studio", "dashboard"}),
    "a command": ("run", SWEEP | NO_SEED, "", {"studio", "dashboard"}),
    "a generalist": (
        "run",
        SWEEP | {"evaluator": "generalist", "generalist": FEW},
        TRAINED,
        {"run"},
    ),
    "a search": ("search", SEARCH | LOG, "--set search.trials=4", {"run", "view", "dashboard"}),
}


def commands_in(text: str) -> set[str]:
    """Those in text, at the end of a line, and in pages."""
    lines = re.findall(r"(?:^|: |^MLflow  )(lidarplace .+)$", text, re.MULTILINE)
    lines += re.findall(r'<pre class="command">(lidarplace .+?)</pre>', text, re.DOTALL)
    return {html.unescape(line) for line in lines}


def called(line: str, monkeypatch) -> str:
    """What a command line prints; it ends where it would start a server."""
    words = shlex.split(line)[1:]
    monkeypatch.setattr(sys, "argv", ["lidarplace", *words])
    with patch("lidarplace.studio.page.server.serving", side_effect=ACCEPTED):
        stops_at = LINES["dashboard"].stops_at
        with patch(stops_at, side_effect=ACCEPTED):
            done = call(app, *words)
    return done.output


@pytest.mark.parametrize("kind", CASES)
def test_printed_commands(kind, tmp_path, monkeypatch):
    verb, config, options, verbs = CASES[kind]
    monkeypatch.chdir(tmp_path)
    write_small_log(Path("log"))
    write_database(Path("runs/mlflow.db"))
    Path("toy.py").write_text(TOY)
    Path("my file.yaml").write_text(yaml.safe_dump(config | {"name": "mine"}))
    if kind == "a command":
        Path("truth").mkdir()
        Path("truth/000003.txt").write_text(CAR)
    printed = commands_in(called(f"lidarplace {verb} 'my file.yaml' {options}", monkeypatch))
    for page in Path("runs/mine").glob("*.html"):
        printed |= commands_in(page.read_text())
    assert verbs <= {line.split()[1] for line in printed}
    for line in sorted(printed):
        dry = " --dry-run" if line.split()[1] in ("run", "search") else ""
        called(re.sub(r"\bLOG\b", "log", line) + dry, monkeypatch)
    called(f"lidarplace status 'my file.yaml' {options}", monkeypatch)
