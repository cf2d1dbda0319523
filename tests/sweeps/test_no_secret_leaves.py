"""A sweep whose store and MLflow have passwords: none is in what it leaves or says."""

import json
import os
from pathlib import Path

import pytest
import yaml
from fsspec.implementations.memory import MemoryFileSystem
from small_log import write_small_log
from typer.testing import CliRunner

from sweeps.commands import clean, doctor, run, search, status
from sweeps.search.judgement.verify import read_verification
from sweeps.search.problem.problem import read_problem

SECRET = "g3h3im"
URL = f"memory://me:{SECRET}@place/store?token={SECRET}"
SMALL = {
    "scene": {"source": "log", "folder": "log"},
    "classes": ["Car"],
    "detector": None,
    "placement": "line",
    "lidar": {"azimuth_steps": 90},
    "surrogate": {"resolution": 0.8, "accuracy": False, "sampling_error": False},
    "output": "runs",
    "ray": "debug",
    "store": URL,
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(MemoryFileSystem, "store", {})
    write_small_log(tmp_path / "log")
    return tmp_path


def call(app, *arguments: str, code: int = 0):
    found = CliRunner().invoke(app, [*arguments])
    assert found.exit_code == code, (found.output, found.exception)
    assert SECRET not in found.output
    return found


def nothing_in(*folders: str):
    for folder in folders:
        for path, _, names in os.walk(folder):
            assert SECRET not in path
            for name in names:
                file = Path(path, name)
                assert SECRET.encode() not in file.read_bytes(), file


def test_a_sweep(folder, monkeypatch):
    Path("small.yaml").write_text(yaml.safe_dump(SMALL))
    monkeypatch.setattr("sys.argv", ["run", "small.yaml", "--set", f"store.url={URL}"])
    call(run.app, "small.yaml")
    nothing_in("runs")
    config = Path("runs/small/config.yaml").read_text()
    assert "me:***@place/store?token=***" in config
    assert "me:***@place" in json.loads(Path("runs/small/sweep.json").read_text())["command"]
    assert any(SECRET in name for name in MemoryFileSystem.store), "used as it is"
    again = call(run.app, "small.yaml")
    assert "done" not in again.output, "all was found there"
    call(run.app, "small.yaml", "--dry-run", "--json")
    call(status.app, "small.yaml", "--json")
    call(doctor.app, "small.yaml")
    call(clean.app, "small.yaml", "--dry-run")
    call(clean.app, "small.yaml", code=2)
    call(clean.app, URL, "--forget", "nosuch", "--unlocked", code=2)
    # What was left cannot be run as it is, and says why.
    told = call(run.app, "runs/small/config.yaml", code=2)
    assert "the secret was left out" in told.output
    call(run.app, "small.yaml", "--set", f"store.url=nosuch://me:{SECRET}@place", code=2)
    call(run.app, "small.yaml", "--set", f"tracking.uri=nosuch://me:{SECRET}@place", code=2)
    call(run.app, "small.yaml", "--set", f"store.quota_gb=http://me:{SECRET}@place", code=2)


def test_a_search_and_the_sweep_that_it_leaves(folder, monkeypatch):
    own = {
        "objective": "expected_ig",
        "lidars": 1,
        "zones": {"roof": {"x": [0, 1], "y": [0, 1], "z": [1.7, 1.8]}},
        "trials": 2,
    }
    config = {key: value for key, value in SMALL.items() if key != "placement"}
    config |= {"search": own | {"objective": "covered_entropy"}, "verify": {"seeds": [1]}}
    config |= {"tracking": {"uri": "sqlite:///runs/mlflow.db"}, "detector": "pointpillars_tiny"}
    Path("small.yaml").write_text(yaml.safe_dump(config))
    call(search.app, "small.yaml", "--no-verify")
    nothing_in("runs")
    problem = read_problem(Path("small.yaml"), [])
    sweep, _ = read_verification(problem)
    assert sweep.common.store.url == URL
    assert sweep.common.tracking_uri == "sqlite:///runs/mlflow.db"
