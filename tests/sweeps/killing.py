"""Start sweeps, kill their processes at random moments, and compare what they leave."""

import os
import random
import signal
import sqlite3
import subprocess
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from tests.forked import GUARD_S, Forked
from tests.mlflow_database import write_database
from tests.sweeps.small_log import SMALL, write_sweep

SWEEP = SMALL | {
    "training": {"epochs": 4, "batch_size": 1},
    "grid": {"placement": ["line", "center"], "seed": [1, 2]},
}


@dataclass
class Sweep:
    """One sweep in a folder of its own.

    Attributes:
        folder: for everything.
        ray: the key of the configuration.
        database: whether MLflow's is there already; to make it takes a third of a sweep's time.
        kills: what was killed and how long after the start of a run.
        runs: how often the command was given.
        found: finished results after every run, by their folder: when each was written.
    """

    folder: Path
    ray: object
    database: bool = False
    kills: list[tuple[str, float]] = field(default_factory=list)
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


def kill_once(sweep: Sweep, after: float, choice: random.Random) -> bool:
    """Run the sweep and kill one of its processes some time after the start; False if it was
    finished by then."""
    process = sweep.start()
    try:
        return _finished(sweep, process.wait(timeout=after))
    except subprocess.TimeoutExpired:
        pass
    kind, pid = _victim(process.pid, choice)
    below = descendants(process.pid)
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
    code = process.wait(timeout=GUARD_S)
    if kind == "driver" and code == 0:  # it had just ended by itself
        return _finished(sweep, code)
    sweep.kills.append((kind, after))
    if kind == "driver":
        assert code == -signal.SIGKILL
    elif code:  # without its node the driver has to end; a worker's task is tried again
        assert code == 1
        assert "run the same command to resume" in sweep.output(), sweep.output()
        assert "Traceback" not in sweep.output(), sweep.output()
    wait_for_end(below)
    sweep.look()
    return code != 0


def _finished(sweep: Sweep, code: int) -> bool:
    """False, after a look at a run that nobody killed."""
    assert code == 0, sweep.output()
    sweep.look()
    return False


def _victim(driver: int, choice: random.Random) -> tuple[str, int]:
    """A kind of process, and one of that kind; the driver if there is no other yet."""
    found: dict[str, list[int]] = {"driver": [driver]}
    for pid, line in descendants(driver).items():
        if line.startswith("ray::") and "Agent" not in line:
            found.setdefault("worker", []).append(pid)
        elif "raylet/raylet" in line:
            found.setdefault("node", []).append(pid)
    kind = choice.choice(sorted(found))
    return kind, choice.choice(found[kind])


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
    for name in ("surrogates",):
        tables = [
            pd.read_parquet(folder / f"{name}.parquet").drop(columns="seconds", errors="ignore")
            for folder in (ours, theirs)
        ]
        if not tables[0].equals(tables[1]):  # bit for bit
            found.append(f"{name} differs")
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
