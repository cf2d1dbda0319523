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
    assert "run the same command to resume" in sweep.output()
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
    """Sweeps one after the other, each killed until it is finished."""
    undisturbed, seconds = reference
    choice = random.Random(1)
    kinds, sweeps = Counter(), []
    while kinds.total() < LONG_KILLS:
        sweep = Sweep(tmp_path / f"sweep{len(sweeps)}", {"num_cpus": 2})
        left = LONG_KILLS - kinds.total()
        while len(sweep.kills) < left and kill_once(
            sweep, choice.uniform(0.0, 2 * seconds), choice
        ):
            pass
        sweep.finish()
        assert differences(sweep, undisturbed) == []
        sweeps.append(sweep)
        kinds.update(kind for kind, _ in sweep.kills)
    runs = sum(sweep.runs for sweep in sweeps)
    print(f"{dict(kinds)}, {runs} runs, {len(sweeps)} sweeps, no differences")
    assert set(kinds) == {"driver", "worker", "node"}
