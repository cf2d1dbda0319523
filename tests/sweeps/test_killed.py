"""Sweeps that are killed, run twice at once, or whose disk is full, end as if left alone."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sweeps.store.lock import locked
from tests.forked import GUARD_S, Forked
from tests.mlflow_database import write_database
from tests.sweeps.small_log import SMALL, write_sweep

SWEEP = SMALL | {
    "training": {"epochs": 4, "batch_size": 1},
    "grid": {"placement": ["line", "center"], "seed": [1, 2]},
}
RAYS = ("--set", "lidar={beams: 8, azimuth_steps: 90}")
FEW = (*RAYS, "--set", "grid={placement: [line], seed: [1, 2]}")
SHORT = ("--set", "training.epochs=1", "--set", "grid={placement: [line]}")


@dataclass
class Sweep:
    """One sweep in a folder of its own; its database may be there already, which saves time.

    Attributes:
        runs: how often the command was given.
        found: finished results after every run, by their folder: when each was written.
    """

    folder: Path
    ray: object
    database: bool = False
    runs: int = 0
    found: dict[Path, int] = field(default_factory=dict)

    def __post_init__(self):
        self.folder.mkdir(parents=True)
        if self.database:
            write_database(self.folder / "runs/mlflow.db")
        write_sweep(self.folder, "tiny.yaml", **SWEEP | {"ray": self.ray})

    def start(self, *options: str) -> Forked:
        """Give the command."""
        self.runs += 1
        command = ["run", "tiny.yaml", *options]
        # Five refused checks make a dead node; one that is only slow has ten seconds for each.
        environment = os.environ | {"RAY_health_check_period_ms": "300"}
        log = self.folder / f"run{self.runs}.log"
        return Forked(command, self.folder, log, environment=environment)

    def output(self) -> str:
        """What the last run printed."""
        return (self.folder / f"run{self.runs}.log").read_text()

    def finish(self, *options: str) -> None:
        """Run to the end."""
        process = self.start(*options)
        code = process.wait(timeout=GUARD_S)
        assert code == 0, self.output()
        self.look()

    def look(self) -> None:
        """Note finished results; none of those noted before may have been written again."""
        store = self.folder / "runs/store"
        now = {p.parent: p.stat().st_mtime_ns for p in store.glob("*/[0-9a-f]*/result.json")}
        redone = [path for path, written in self.found.items() if now.get(path) != written]
        assert not redone, f"computed again: {redone}"
        self.found = now


def descendants(root: int) -> dict[int, str]:
    """Command lines of all processes below `root`."""
    parents, lines = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        parents[int(folder.name)] = int(stat[1])
        lines[int(folder.name)] = _command(int(folder.name))
    below = {root}
    while more := {pid for pid, parent in parents.items() if parent in below} - below:
        below |= more
    return {pid: lines[pid] for pid in below - {root} if lines[pid]}  # a zombie has no line


def wait_for_end(processes: dict[int, str]) -> None:
    """Wait for the processes of a driver that is gone: Ray's end by themselves. Its agents compute
    nothing; one that was starting looks for its node for more than a minute."""
    deadline = time.monotonic() + GUARD_S
    working = {pid: line for pid, line in processes.items() if "agent" not in line.lower()}
    while any(_command(pid) == line for pid, line in working.items()):
        assert time.monotonic() < deadline, "processes outlive their driver"
        time.sleep(0.1)


def _command(pid: int) -> str:
    """Command line of a process, empty if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return ""


def differences(sweep: Sweep, reference: Sweep) -> list[str]:
    """What differs between two finished sweeps that ought to be alike."""
    found = []
    ours, theirs = (s.folder / "runs/tiny" for s in (sweep, reference))
    one, two = (pd.read_parquet(folder / "surrogates.parquet") for folder in (ours, theirs))
    if not one.drop(columns="seconds").equals(two.drop(columns="seconds")):  # bit for bit
        found.append("surrogates differ")
    keys_of = {"results": ["trial", "class", "metric", "iou", "difficulty"]}
    for name, keys in (keys_of | {"curves": ["trial", "epoch", "metric"]}).items():
        one, two = (pd.read_parquet(folder / f"{name}.parquet") for folder in (ours, theirs))
        if "metric" in one:
            one, two = (table[table["metric"] != "seconds"] for table in (one, two))
        both = one.merge(two, on=keys, suffixes=("", "_reference"), how="outer", validate="1:1")
        near = np.isclose(both["value"], both["value_reference"], rtol=1e-5, equal_nan=True)
        if len(both) != len(two) or not near.all():
            found.append(f"{name}: {len(both)} rows for {len(two)}, {(~near).sum()} differ")
    logged, expected = (_mlflow(s.folder / "runs/mlflow.db") for s in (sweep, reference))
    for name in expected:
        if logged[name] != expected[name]:
            found.append(f"MLflow's {name}: {logged[name]} and {expected[name]}")
    return found


def _mlflow(path: Path) -> dict[str, object]:
    """Names of runs with their status, and how many parameters and points of metrics each has."""
    with sqlite3.connect(path) as database:
        runs = database.execute("select name, status from runs").fetchall()
        params = database.execute(
            "select name, count(*) from params join runs using (run_uuid) group by run_uuid"
        ).fetchall()
        points = database.execute(
            "select name, key, step, is_nan from metrics join runs using (run_uuid) "
            "where key not like 'system/%'"  # of the machine
        ).fetchall()
    counted = sorted(Counter(points).items())
    return {"runs": sorted(runs), "params": sorted(params), "points": counted}


def test_processes_of_ray_killed(tmp_path):
    """A worker in the middle of a training, then the node, then the driver; the end without Ray."""
    reference = Sweep(tmp_path / "reference", "debug", database=True)
    reference.finish(*FEW)
    sweep = Sweep(tmp_path / "sweep", {"num_cpus": 1}, database=True)
    process = sweep.start(*FEW)
    first = wait_for_training(sweep, process)
    os.kill(first, signal.SIGKILL)
    wait_for_training(sweep, process, other_than=first)  # Ray tries again
    below = descendants(process.pid)
    (node,) = [pid for pid, line in below.items() if "raylet/raylet" in line]
    os.kill(node, signal.SIGKILL)
    assert process.wait(timeout=GUARD_S) == 1
    assert "run the same command to resume" in sweep.output()
    assert "Traceback" not in sweep.output()
    wait_for_end(below)
    sweep.look()
    process = sweep.start(*FEW)
    wait_for_training(sweep, process)
    below = descendants(process.pid)
    process.kill()
    assert process.wait(timeout=GUARD_S) == -signal.SIGKILL
    wait_for_end(below)
    sweep.look()
    sweep.finish(*FEW, "--set", "ray=debug")
    assert differences(sweep, reference) == []


def wait_for_training(sweep, process, other_than=None):
    """Process that trains, when it has done an epoch or more."""
    deadline = time.monotonic() + GUARD_S
    while time.monotonic() < deadline:
        assert process.poll() is None, sweep.output()
        for note in sweep.folder.glob("runs/store/finetune/.*.running"):
            key = note.name.split(".")[1]
            if list(note.parent.glob(f".{key}.working/*/last.pt")):
                try:
                    pid = json.loads(note.read_text())["pid"]
                except FileNotFoundError:  # it has ended since
                    continue
                if pid != other_than:
                    return pid
        time.sleep(0.02)
    raise AssertionError("no training began")


def test_the_second_driver_of_a_sweep_is_refused(tmp_path):
    sweep = Sweep(tmp_path / "sweep", "debug")
    with locked(sweep.folder / "runs/tiny", alone=True):
        process = sweep.start()
        assert process.wait(timeout=GUARD_S) == 2
    assert sweep.output().count("\n") == 1
    assert "runs/tiny: in use by a running sweep" in sweep.output()
    assert not (sweep.folder / "runs/store").exists()


def test_two_sweeps_share_a_store(tmp_path):
    """They compute the same at the same time, and create one database."""
    sweep = Sweep(tmp_path / "sweep", "debug")
    few = (*SHORT, *RAYS)
    one, other = sweep.start(*few), sweep.start(*few, "--set", "name=other")
    codes = [process.wait(timeout=GUARD_S) for process in (one, other)]
    assert codes == [0, 0], "\n".join((sweep.folder / f"run{n}.log").read_text() for n in (1, 2))
    for name in ("surrogates", "results"):
        files = (sweep.folder / f"runs/{run}/{name}.parquet" for run in ("tiny", "other"))
        ours, theirs = map(pd.read_parquet, files)
        assert len(ours)
        pd.testing.assert_frame_equal(ours, theirs)
    hidden = [p.name for p in sweep.folder.glob("runs/store/*/.*")]
    assert hidden == [], "nothing is left of the slower one"


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 1.5 MB, and a function that makes it larger."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1500k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs the rights of root")

    def grow():
        subprocess.run(["mount", "-o", "remount,size=100m", str(folder)], check=True)

    yield folder, grow
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk(tmp_path, small_disk):
    disk, grow = small_disk
    sweep = Sweep(tmp_path / "sweep", "debug", database=True)
    options = (*SHORT, "--set", f"store={disk}/store")
    assert sweep.start(*options).wait(timeout=GUARD_S) == 1
    pattern = r"No space left on device: [\d.]+ MB are free on (\S+): '(\S+)'"
    told = re.search(pattern, sweep.output())
    assert told, sweep.output()
    assert told[1] == str(disk)
    assert told[2].startswith(f"{disk}/store/")
    assert "1 of 1 trials failed" in sweep.output()
    left = list((disk / "store").glob("*/.*.part"))
    assert left == [], "nothing half written takes up the space"
    grow()
    assert sweep.start(*options).wait(timeout=GUARD_S) == 0, sweep.output()
    trials = pd.read_parquet(sweep.folder / "runs/tiny/trials.parquet")
    assert trials["status"].tolist() == ["finished"]
    assert not list((sweep.folder / "runs/tiny/failed").iterdir())
