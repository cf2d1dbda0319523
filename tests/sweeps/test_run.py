"""A whole tiny sweep through the command line."""

import json
import re
import sqlite3
import subprocess
from pathlib import Path

import pandas as pd
import pytest
import yaml

from lidarplace.base.metrics import METRICS
from tests.forked import run_forked
from tests.mlflow_database import write_database
from tests.sweeps.small_log import TOWN

ROOT = Path(__file__).parents[2]
TINY = {
    "scene": TOWN,
    "lidar": {"azimuth_steps": 120, "range_noise": 0.02, "drop_off": 0.05},
    "surrogate": {"resolution": 0.4},
    "training": {"epochs": 1, "batch_size": 2},
    "grid": {"placement": ["line", "center"], "seed": [1]},
    "ray": {"num_cpus": 1},
}


def sweep(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    config = folder / "tiny.yaml"
    config.write_text(yaml.safe_dump(TINY | {"output": str(folder / "runs")}))
    return run_forked(["run", str(config), *options], ROOT, folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    write_database(folder / "runs/mlflow.db")
    return folder


@pytest.fixture(scope="module")
def first(folder):
    result = sweep(folder)
    assert result.returncode == 0, result.stdout + result.stderr
    return result


def mlflow_runs(folder):
    with sqlite3.connect(folder / "runs/mlflow.db") as database:
        return dict(database.execute("select name, status from runs").fetchall())


def test_the_run_folder_holds_the_results(folder, first):
    run = folder / "runs/tiny"
    results = pd.read_parquet(run / "results.parquet")
    assert set(results["placement"]) == {"line", "center"}
    assert set(results["metric"]) == set(METRICS)
    assert results["value"].dropna().between(0, 100).all()
    surrogates = pd.read_parquet(run / "surrogates.parquet")
    assert set(surrogates["surrogate"]) >= {"s_mig", "expected_ig", "m_sog"}
    assert set(surrogates["class"]) == {"Car", "Cyclist", "Pedestrian"}
    car = surrogates[surrogates["class"] == "Car"].pivot(
        index="placement", columns="surrogate", values="value"
    )
    assert (car["s_mig"] < 0).all()
    assert (car["ig"] - car["h_pog"]).to_list() == pytest.approx(car["s_mig"].to_list())
    accuracy = pd.read_parquet(run / "accuracy.parquet")
    reference = accuracy[accuracy["reference"]]
    assert set(reference["resolution"]) == {0.2}
    assert reference.groupby(["placement", "surrogate"]).size().eq(1).all()
    seen = accuracy[(accuracy["method"] == "dda") & (accuracy["surrogate"] == "s_mig")]
    assert seen.groupby("placement")["azimuth_steps"].apply(set).eq({90, 360, 1440, 5760}).all()
    error = pd.read_parquet(run / "sampling_error.parquet")
    keys = ["placement", "class", "surrogate"]
    both = error.merge(surrogates, on=keys, suffixes=("", "_of_stage"))
    assert len(both) == len(error) == 2 * 3 * 8
    assert both["value"].to_list() == pytest.approx(both["value_of_stage"].to_list())
    assert (error["low"] <= error["high"]).all()
    drawn = pd.read_parquet(run / "pog_resamples.parquet")
    assert drawn.groupby(keys).size().eq(error["resamples"].iloc[0]).all()
    objects = pd.read_parquet(run / "individuals.parquet")
    assert not objects.duplicated(["split", "scene", "route", "object_id"]).any()
    boxes = objects[objects["split"] == "test"].groupby("class")["boxes"].sum()
    of_class = results[results["class"] != "all"].groupby("class")["ground_truths"]
    assert of_class.agg(set).to_dict() == {name: {boxes.get(name, 0)} for name, _ in of_class}
    about = json.loads((run / "sweep.json").read_text())
    assert about["frames"] == {"train": 8, "test": 4}
    assert about["tracking_uri"] == f"sqlite+pysqlite:///{folder / 'runs/mlflow.db'}"
    assert about["command"].startswith("lidarplace run ")
    model = {"name": None, "price_usd": None, "beams": 16, "azimuth_steps": 120}
    model["elevation_deg"] = [-25.0, 5.0]
    assert about["lidars"] == dict.fromkeys(("line", "center"), [model] * 4)
    assert (run / "report.html").stat().st_size > 1e6
    artifacts = next((folder / "runs/artifacts").glob("*/artifacts/sweep.json")).parent
    logged = {path.name for path in artifacts.iterdir()}
    assert logged >= {"decision.html", "report.html", "report.md", "config.yaml"}
    tables = {path.name for path in (run / "tables").iterdir()}
    assert {path.name for path in (artifacts / "tables").iterdir()} == tables != set()
    assert "line" in first.stdout
    assert "lidarplace dashboard" in first.stdout


def test_mlflow_has_a_parent_and_a_run_for_every_trial(folder, first):
    trials = (f"{name} · pointpillars_tiny · seed 1" for name in ("line", "center"))
    assert mlflow_runs(folder) == dict.fromkeys(["tiny", *trials], "FINISHED")
    with sqlite3.connect(folder / "runs/mlflow.db") as database:
        params = database.execute("select key, value from params").fetchall()
    for param in (("weights", "scratch"), ("batch_size", "2"), ("training.batch_size", "2")):
        assert params.count(param) == 2


def test_the_plan_shows_what_is_cached(folder, first):
    plan = sweep(folder, "--dry-run", "--set", "grid.seed=[1, 2]")
    assert plan.returncode == 0
    assert "8 frames to train, 4 to test" in plan.stdout
    rows = {
        cells[0]: [int(c) for c in cells[1:4]]
        for line in plan.stdout.splitlines()
        if len(cells := line.split()) == 4 and cells[1].isdigit()
    }
    assert rows["scene"] == [2, 2, 0]
    assert rows["collect"] == [4, 4, 0]
    assert rows["finetune"] == [4, 2, 2]
    assert "line · pointpillars_tiny · seed 1  (cached)" in plan.stdout
    page = (folder / "runs/tiny/rigs.html").read_text(encoding="utf-8")
    assert "runs/tiny/rigs.html" in plan.stdout
    assert "4 LiDARs" in page
    assert "center" in page


def test_the_same_command_does_nothing_twice(folder, first):
    before = pd.read_parquet(folder / "runs/tiny/results.parquet")
    again = sweep(folder)
    assert again.returncode == 0, again.stdout + again.stderr
    assert pd.read_parquet(folder / "runs/tiny/tasks.parquet")["cached"].all()
    about = json.loads((folder / "runs/tiny/sweep.json").read_text())
    assert about.get("cores") is None, "Ray was not started"
    pd.testing.assert_frame_equal(pd.read_parquet(folder / "runs/tiny/results.parquet"), before)
    assert len(mlflow_runs(folder)) == 3


def test_a_failed_trial_does_not_stop_the_others(folder, first):
    grid = "grid={placement: [line], training.lr: [0.01, 1.0e+6]}"
    result = sweep(folder, "--set", "ray=debug", "--set", grid)
    assert result.returncode == 1
    assert "1 of 2 trials failed" in result.stdout
    assert re.search(r"in epoch 1, step \d+, frames", result.stdout)
    trials = pd.read_parquet(folder / "runs/tiny/trials.parquet")
    assert sorted(trials["status"]) == ["failed", "finished"]
