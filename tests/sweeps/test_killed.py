"""Sweeps that are killed at random moments end as those that were left alone."""

import json
import os
import random
import signal
import time
from collections import Counter

import pytest
from killing import Sweep, descendants, differences, kill_once, wait_for_end

from tests.forked import GUARD_S

LONG_KILLS = 21


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """An undisturbed sweep in one process, and the seconds that it took."""
    sweep = Sweep(tmp_path_factory.mktemp("reference") / "sweep", "debug")
    start = time.monotonic()
    sweep.finish()
    return sweep, time.monotonic() - start


def kill_often(folder, ray, kills, seconds, reference):
    """Sweeps one after the other, each killed until it is finished, until there were `kills`."""
    choice = random.Random(1)
    sweeps = []
    while sum(len(sweep.kills) for sweep in sweeps) < kills:
        sweep = Sweep(folder / f"sweep{len(sweeps)}", ray)
        sweeps.append(sweep)
        while len(sweep.kills) < kills and kill_once(sweep, choice.uniform(0.0, seconds), choice):
            pass
        sweep.finish()
        assert differences(sweep, reference) == []
    every = [kill for sweep in sweeps for kill in sweep.kills]
    print(
        f"{len(every)} kills ({dict(Counter(kind for kind, _ in every))}), "
        f"{sum(sweep.runs for sweep in sweeps)} runs, {len(sweeps)} sweeps, no differences"
    )
    return every


@pytest.mark.long
def test_a_driver_killed_a_few_times(tmp_path, reference):
    assert len(kill_often(tmp_path, "debug", 2, reference[1], reference[0])) >= 2


def test_processes_of_ray_killed(tmp_path, reference):
    """A worker in the middle of a training, then the node, then the driver."""
    sweep = Sweep(tmp_path / "sweep", {"num_cpus": 2}, database=True)
    process = sweep.start()
    first = wait_for_training(sweep, process)
    os.kill(first, signal.SIGKILL)
    wait_for_training(sweep, process, other_than=first)  # Ray tries again
    below = descendants(process.pid)
    (node,) = [pid for pid, line in below.items() if "raylet/raylet" in line]
    os.kill(node, signal.SIGKILL)
    assert process.wait(timeout=GUARD_S) == 1
    assert "the same command goes on" in sweep.output()
    assert "Traceback" not in sweep.output()
    wait_for_end(below)
    sweep.look()
    process = sweep.start()
    wait_for_training(sweep, process)
    below = descendants(process.pid)
    process.kill()
    assert process.wait(timeout=GUARD_S) == -signal.SIGKILL
    wait_for_end(below)
    sweep.look()
    sweep.finish()
    assert differences(sweep, reference[0]) == []


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


@pytest.mark.long
def test_killed_at_random_many_times(tmp_path, reference):
    kinds = Counter(
        kind
        for kind, _ in kill_often(
            tmp_path, {"num_cpus": 2}, LONG_KILLS, 2 * reference[1], reference[0]
        )
    )
    assert sum(kinds.values()) >= 20
    assert set(kinds) == {"driver", "worker", "node"}
