"""Searches for a measured value: a detector is trained for every trial."""

import json

import pandas as pd
import pytest
from search_files import write_search
from typer.testing import CliRunner

from sweeps.commands.search import app
from sweeps.search.trials import by_detectors

TINY = {
    "detector": "pointpillars_tiny",
    "training": {"epochs": 2, "batch_size": 1},
    "lidar": {"azimuth_steps": 180},
}


@pytest.fixture(scope="module")
def tracking(tmp_path_factory):
    return {"uri": f"sqlite:///{tmp_path_factory.mktemp('mlflow') / 'mlflow.db'}"}


def search(folder, tracking, **changes):
    path = write_search(folder, tracking=tracking, **TINY | changes)
    result = CliRunner().invoke(app, [str(path)], catch_exceptions=False)
    run = folder / "runs/small"
    about = json.loads((run / "search.json").read_text())
    return result, pd.read_parquet(run / "trials.parquet"), about


def test_a_resumed_search_trains_nothing_again(tmp_path, tracking, monkeypatch):
    def height(objective, trials, store):  # tiny trainings find nothing, so all would be alike
        return 10 * trials[0].evaluate.inputs[1].params.placement.mounts[0].z

    monkeypatch.setattr(by_detectors, "measured_value", height)
    options = {
        "objective": "recall",
        "sampler": "random",
        "trials": 6,
        "batch_size": 6,
        "constraints": {"distance": 0.5},
    }
    result, table, found = search(tmp_path, tracking, search=options)
    assert result.exit_code == 0, result.output
    feasible = table[table["feasible"]]
    assert (table.loc[~table["feasible"], "state"] == "PRUNED").all()
    assert (feasible["state"] == "COMPLETE").all()
    best = feasible["lidar_1.z_m"].idxmax()
    assert found["rigs"]["found_1"]["values"]["recall"] == 10 * table.loc[best, "lidar_1.z_m"]
    store = tmp_path / "runs/store"
    assert len(list(store.glob("finetune/*"))) == len(feasible) > 1
    before = {path: path.stat().st_mtime_ns for path in store.rglob("*") if path.is_file()}
    journal = tmp_path / "runs/small/optuna.journal"
    journal.unlink()  # a search that lost its trials finds their trainings
    result, again, _ = search(tmp_path, tracking, search=options)
    after = {path: path.stat().st_mtime_ns for path in store.rglob("*") if path.is_file()}
    own = {p: t for p, t in after.items() if "/finetune/" in str(p)}
    assert own == {p: t for p, t in before.items() if "/finetune/" in str(p)}
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), table.drop(columns="seconds"))


def test_a_training_that_fails_is_told_as_failed(tmp_path, tracking):
    result, table, _ = search(
        tmp_path,
        tracking,
        training=TINY["training"] | {"lr": 1e6},
        search={"objective": "recall", "constraints": {"distance": 0}, "trials": 1},
    )
    assert result.exit_code == 1
    assert table.loc[0, "state"] == "FAIL"
    assert "is nan in epoch" in table.loc[0, "failure"]
    assert "is nan in epoch" in result.output
    assert "No placement keeps" not in result.output
