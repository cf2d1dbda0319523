"""A bad disk changes a bit of a result: the same command names it, and goes on to the same end."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from sweeps.commands import clean, record, run, status
from sweeps.execution.interrupted import until_whole
from sweeps.execution.worker import _load
from sweeps.store.result_folder import DamagedResult, damaged
from tests.sweeps.small_log import SMALL, write_sweep
from tests.sweeps.toy import call, flip_bit

FEW = SMALL | {"lidar": {"beams": 8, "azimuth_steps": 90}}
SURROGATES = FEW | {"detector": None, "grid": {"placement": ["line", "center"]}}
TABLES = ("surrogates", "results", "distance", "points", "trials")


def again():
    """Run the sweep as a process of its own would, which has not read a result yet."""
    _load.cache_clear()
    return call(run.app, "small.yaml")


def sweep(folder: Path, config) -> None:
    write_sweep(folder, "small.yaml", **config)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        again()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which a sweep of surrogates has run."""
    folder = tmp_path_factory.mktemp("finished")
    sweep(folder, SURROGATES)
    return folder


@pytest.fixture
def before(finished, tmp_path, monkeypatch):
    """Its tables, in a copy of it."""
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tables()


def tables() -> dict[str, pd.DataFrame]:
    found = {name: pd.read_parquet(f"runs/small/{name}.parquet") for name in TABLES}
    return {name: table.drop(columns="seconds", errors="ignore") for name, table in found.items()}


def files() -> list[Path]:
    """All files of all results."""
    return sorted(path for path in Path("runs/store").glob("*/*/*") if path.parent.name[0] != ".")


def assert_equal(found, expected):
    for name, table in expected.items():
        pd.testing.assert_frame_equal(found[name], table)


def test_the_same_command_mends_every_result_that_it_reads(before):
    for path in files():
        flip_bit(path, 0.5)
    found = again()
    assert_equal(tables(), before)
    for stage in ("pog", "surrogates", "scene"):
        for result in Path("runs/store", stage).iterdir():
            lines = [line for line in found.output.splitlines() if str(result) in line]
            assert len(lines) == 1, found.output
            assert "is damaged" in lines[0]
    # A table that is made anew from a damaged one is not made from that, nor from another's.
    one, other = Path("runs/store/surrogates").iterdir()
    shutil.rmtree(one)
    shutil.copytree(other, one)
    (counts,) = Path("runs/store/pog").glob("*/counts_Car.npy")
    flip_bit(counts, 0.6)
    found = again()
    told = f"{one} is damaged: its result.json is of surrogates/{other.name}"
    assert found.output.count(told) == found.output.count("is damaged: counts_Car.npy") == 1
    assert found.output.count("is damaged") == 2
    assert_equal(tables(), before)


def test_other_commands_take_a_damaged_result_for_none(before):
    promoted = {"detector": "pointpillars_tiny", "promote": [{"by": "covered_entropy", "keep": 1}]}
    write_sweep(Path(), "small.yaml", **SURROGATES | promoted)
    (damaged_one, *_) = Path("runs/store/surrogates").glob("*/table.parquet")
    flip_bit(damaged_one, 0.5)
    found = call(status.app, "small.yaml", "--json")
    assert str(damaged_one.parent) in found.stderr
    state = json.loads(found.stdout)
    assert state["stages"]["surrogates"] == {"done": 1, "waiting": 1}
    planned = json.loads(call(run.app, "small.yaml", "--dry-run", "--json").stdout)
    assert planned["stages"]["surrogates"] == {"tasks": 2, "cached": 1}
    call(clean.app, "small.yaml", "--dry-run")
    (boxes,) = Path("runs/store/scene").glob("*/boxes.parquet")
    flip_bit(boxes, 0.5)
    recorded = call(record.app, "small.yaml", "logs")
    assert "boxes.parquet is not what was written" in recorded.output
    assert list(Path("logs").glob("*/boxes.parquet"))


def test_a_disk_that_spoils_everything_is_given_up():
    told = []

    def work():
        raise damaged("store/scene/1", "table.parquet is not what was written")

    with pytest.raises(DamagedResult):
        until_whole(work, told.append)
    assert len(told) == 2
