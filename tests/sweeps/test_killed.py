"""Sweeps that are killed, run twice at once, or whose disk is full, end as if left alone."""

import json
import os
import random
import re
import signal
import subprocess
import time
from collections import Counter

import pandas as pd
import pytest

from sweeps.store.lock import locked
from tests.forked import GUARD_S
from tests.sweeps.killing import Sweep, descendants, differences, kill_once, wait_for_end

LONG_KILLS = 21
RAYS = ("--set", "lidar={beams: 8, azimuth_steps: 90}")
FEW = (*RAYS, "--set", "grid={placement: [line], seed: [1, 2]}")
SHORT = ("--set", "training.epochs=1", "--set", "grid={placement: [line]}")


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


@pytest.mark.long
def test_killed_at_random_many_times(tmp_path):
    """Sweeps one after the other, each killed until it is finished."""
    undisturbed, start = Sweep(tmp_path / "reference", "debug", database=True), time.monotonic()
    undisturbed.finish()
    seconds = time.monotonic() - start
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
