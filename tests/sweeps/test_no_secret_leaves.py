"""A sweep whose store and MLflow have passwords: none is in what it leaves or says."""

import json
import os
from pathlib import Path

import pytest
from fsspec.implementations.memory import MemoryFileSystem

from sweeps.commands import clean, doctor, run, search, status
from sweeps.search.problem.problem import read_problem
from sweeps.search.verification.verify import read_verification
from tests.sweeps.small_log import SMALL, write_sweep
from tests.sweeps.toy import call

SECRET = "g3h3im"
URL = f"memory://me:{SECRET}@place/store?token={SECRET}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(MemoryFileSystem, "store", {})
    write_sweep(tmp_path, "small.yaml", **SMALL, detector=None, placement="line", store=URL)
    return tmp_path


def safe(app, *arguments: str, code: int = 0):
    found = call(app, *arguments, code=code)
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
    monkeypatch.setattr("sys.argv", ["run", "small.yaml", "--set", f"store.url={URL}"])
    safe(run.app, "small.yaml")
    nothing_in("runs")
    config = Path("runs/small/config.yaml").read_text()
    assert "me:***@place/store?token=***" in config
    assert "me:***@place" in json.loads(Path("runs/small/sweep.json").read_text())["command"]
    assert any(SECRET in name for name in MemoryFileSystem.store), "used as it is"
    again = safe(run.app, "small.yaml")
    assert "done" not in again.output, "all was found there"
    safe(run.app, "small.yaml", "--dry-run", "--json")
    safe(status.app, "small.yaml", "--json")
    safe(doctor.app, "small.yaml")
    safe(clean.app, "small.yaml", "--dry-run")
    safe(clean.app, "small.yaml", code=2)
    safe(clean.app, URL, "--forget", "nosuch", "--unlocked", code=2)
    # What was left cannot be run as it is, and says why.
    told = safe(run.app, "runs/small/config.yaml", code=2)
    assert "the secret was left out" in told.output
    safe(run.app, "small.yaml", "--set", f"store.url=nosuch://me:{SECRET}@place", code=2)
    safe(run.app, "small.yaml", "--set", f"tracking.uri=nosuch://me:{SECRET}@place", code=2)
    safe(run.app, "small.yaml", "--set", f"store.quota_gb=http://me:{SECRET}@place", code=2)


def test_a_search_and_the_sweep_that_it_leaves(folder, monkeypatch):
    zones = {"roof": {"x": [0, 1], "y": [0, 1], "z": [1.7, 1.8]}}
    own = {"objective": "covered_entropy", "lidars": 1, "zones": zones, "trials": 2}
    keys = {"search": own, "verify": {"seeds": [1]}, "store": URL}
    keys |= {"tracking": {"uri": "sqlite:///runs/mlflow.db"}, "detector": "pointpillars_tiny"}
    write_sweep(folder, "small.yaml", **SMALL, **keys)
    safe(search.app, "small.yaml", "--no-verify")
    nothing_in("runs")
    problem = read_problem(Path("small.yaml"), [])
    sweep, _ = read_verification(problem)
    assert sweep.common.store.url == URL
    assert sweep.common.tracking_uri == "sqlite:///runs/mlflow.db"
