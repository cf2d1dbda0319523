"""A bad disk changes a bit of a result: the same command names it, and goes on to the same end."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from flip_bit import flip_bit
from small_log import write_small_log
from typer.testing import CliRunner

from sweeps.commands import clean, record, run, status
from sweeps.execution import worker
from sweeps.execution.interrupted import until_whole
from sweeps.store.result_folder import DamagedResult, damaged

SMALL = {
    "scene": {"source": "log", "folder": "log"},
    "classes": ["Car"],
    "detector": None,
    "lidar": {"azimuth_steps": 90},
    "surrogate": {"resolution": 0.8, "accuracy": False, "sampling_error": False},
    "grid": {"placement": ["line", "center"]},
    "output": "runs",
    "ray": "debug",
}
TRAINED = SMALL | {
    "detector": "pointpillars_tiny",
    "training": {"epochs": 1, "batch_size": 1},
    "grid": {"placement": ["line"]},
}
TABLES = ("surrogates", "expected_ig_by_q", "results", "distance", "points", "trials")


def call(app, *arguments):
    worker._load.cache_clear()  # each command has a process of its own
    found = CliRunner().invoke(app, [*arguments])
    assert not found.exception or isinstance(found.exception, SystemExit), found.exception
    return found


def sweep(folder: Path, config) -> dict[str, pd.DataFrame]:
    write_small_log(folder / "log")
    (folder / "small.yaml").write_text(yaml.safe_dump(config))
    found = call(run.app, "small.yaml")
    assert found.exit_code == 0, found.output
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


def test_the_same_command_mends_every_result_that_it_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sweep(tmp_path, SMALL)
    for path in files():
        flip_bit(path, 0.5)
    found = call(run.app, "small.yaml")
    assert found.exit_code == 0, found.output
    assert_equal(tables(), before)
    for stage in ("pog", "surrogates", "scene"):
        for result in Path("runs/store", stage).iterdir():
            lines = [line for line in found.output.splitlines() if str(result) in line]
            assert len(lines) == 1, found.output
            assert "is damaged" in lines[0]
    again = call(run.app, "small.yaml")
    assert "damaged" not in again.output
    # A table that is made anew from a damaged one is not made from that.

    shutil.rmtree("runs/store/surrogates")
    (counts,) = Path("runs/store/pog").glob("*/counts_Car.npy")
    flip_bit(counts, 0.6)
    found = call(run.app, "small.yaml")
    assert found.exit_code == 0, found.output
    assert found.output.count("is damaged: counts_Car.npy") == 1
    assert_equal(tables(), before)


def test_a_result_in_the_place_of_another_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sweep(tmp_path, SMALL)
    one, other = Path("runs/store/surrogates").iterdir()
    shutil.rmtree(other)
    shutil.copytree(one, other)
    found = call(run.app, "small.yaml")
    assert found.exit_code == 0, found.output
    told = f"{other} is damaged: its result.json is of surrogates/{one.name}"
    assert found.output.count(told) == 1, found.output
    assert_equal(tables(), before)


def test_other_commands_take_a_damaged_result_for_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sweep(tmp_path, SMALL)
    promoted = {"detector": "pointpillars_tiny", "promote": [{"by": "covered_entropy", "keep": 1}]}
    Path("small.yaml").write_text(yaml.safe_dump(SMALL | promoted))
    (damaged_one, *_) = Path("runs/store/surrogates").glob("*/table.parquet")
    flip_bit(damaged_one, 0.5)
    found = call(status.app, "small.yaml", "--json")
    assert found.exit_code == 0, found.output
    assert str(damaged_one.parent) in found.stderr
    state = json.loads(found.stdout)
    assert state["stages"]["surrogates"] == {"done": 1, "waiting": 1}
    planned = json.loads(call(run.app, "small.yaml", "--dry-run", "--json").stdout)
    assert planned["stages"]["surrogates"] == {"tasks": 2, "cached": 1}
    cleaned = call(clean.app, "small.yaml", "--dry-run")
    assert cleaned.exit_code == 0, cleaned.output
    (boxes,) = Path("runs/store/scene").glob("*/boxes.parquet")
    flip_bit(boxes, 0.5)
    recorded = call(record.app, "small.yaml", "logs")
    assert recorded.exit_code == 0, recorded.output
    assert "boxes.parquet is not what was written" in recorded.output
    assert list(Path("logs").glob("*/boxes.parquet"))


def test_a_disk_that_spoils_everything_is_given_up():
    told = []

    def work():
        raise damaged("store/scene/1", "table.parquet is not what was written")

    with pytest.raises(DamagedResult):
        until_whole(work, told.append)
    assert len(told) == 2


@pytest.mark.long
def test_one_bit_in_each_file_of_a_finished_sweep(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sweep(tmp_path, TRAINED)
    for path in files():
        flip_bit(path, 0.5)
        found = call(run.app, "small.yaml")
        assert found.exit_code == 0, (path, found.output)
        assert_equal(tables(), before)
        if not path.exists() or f"{path.parent} is damaged" not in found.output:
            print("not read:", path)
            flip_bit(path, 0.5)
