"""A sweep whose disk is full stops with the reason, and goes on when there is space."""

import re
import subprocess

import pandas as pd
import pytest
from killing import Sweep

from tests.forked import GUARD_S


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
    options = ("--set", f"store={disk}/store", "--set", "training.epochs=1")
    options += ("--set", "grid={placement: [line]}")
    assert sweep.start(*options).wait(timeout=GUARD_S) == 1
    told = re.search(
        r"No space left on device: [\d.]+ MB are free on (\S+): '(\S+)'", sweep.output()
    )
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
