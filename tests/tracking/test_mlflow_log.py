"""A sweep in MLflow: found again, continued, never logged twice."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tracking.mlflow_log import SweepLog, trial_metrics, ui_command
from tracking.run_folder import RunFolder

CURVE = pd.DataFrame({"epoch": [1, 2, 3], "metric": "loss", "value": [3.0, 2.0, 1.5]})


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory) -> Path:
    """A database with MLflow's tables: making one costs seconds, copying it nothing."""
    import mlflow

    path = tmp_path_factory.mktemp("mlflow") / "template.db"
    mlflow.MlflowClient(tracking_uri=f"sqlite:///{path}").search_experiments()
    return path


@pytest.fixture
def uri(empty_database, tmp_path) -> str:
    (tmp_path / "store").mkdir()
    shutil.copy(empty_database, tmp_path / "store" / "mlflow.db")
    return f"sqlite:///{tmp_path}/store/mlflow.db"


def client(uri):
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def runs_of(uri, name="demo"):
    mlflow = client(uri)
    experiment = mlflow.get_experiment_by_name(name)
    return {run.info.run_name: run for run in mlflow.search_runs([experiment.experiment_id])}


def log_two(uri, key="k1"):
    with SweepLog(uri, "demo", key, {"epochs": 3}) as log:
        return [
            log.trial(
                f"t{seed}",
                f"line · tiny · seed {seed}",
                {"seed": seed},
                {"AP_R40_3D.Car.0.70": 60.0 + seed, "recall.all.0.50": np.nan},
                CURVE,
            )
            for seed in (1, 2)
        ]


def test_a_sweep_is_a_parent_and_a_child_a_trial(uri, tmp_path):
    figure = tmp_path / "report.html"
    figure.write_text("<p>report</p>")
    with SweepLog(uri, "demo", "k1", {"epochs": 3}) as log:
        log.trial("t1", "line · tiny · seed 1", {"seed": 1}, {"seconds": 2.5}, CURVE)
        log.artifact(figure)
        parent_id = log.parent_run_id
    runs = runs_of(uri)
    parent, child = runs["demo"], runs["line · tiny · seed 1"]
    assert parent.info.run_id == parent_id
    assert parent.data.params == {"epochs": "3"}
    assert child.data.tags["mlflow.parentRunId"] == parent_id
    assert child.data.metrics == {"seconds": 2.5, "loss": 1.5}
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    history = client(uri).get_metric_history(child.info.run_id, "loss")
    assert [(point.step, point.value) for point in history] == [(1, 3.0), (2, 2.0), (3, 1.5)]
    files = [path.name for path in (tmp_path / "store" / "artifacts").rglob("*.html")]
    assert files == ["report.html"]


def test_a_resumed_sweep_doubles_nothing(uri):
    assert log_two(uri) == [True, True]
    before = runs_of(uri)
    assert log_two(uri) == [False, False]
    after = runs_of(uri)
    assert {name: run.info.run_id for name, run in after.items()} == {
        name: run.info.run_id for name, run in before.items()
    }
    child = after["line · tiny · seed 1"]
    assert len(client(uri).get_metric_history(child.info.run_id, "loss")) == 3
    assert "recall.all.0.50" not in child.data.metrics


@pytest.mark.parametrize("stops_before", ["log_batch", "set_terminated"])
def test_a_trial_cut_half_way_is_continued(uri, monkeypatch, stops_before):
    log_two(uri)
    from mlflow import MlflowClient

    whole = getattr(MlflowClient, stops_before)
    written: list[str] = []
    parent = ""

    def stop(self, run_id, *arguments, **named):
        if named.get("metrics") or (stops_before == "set_terminated" and run_id != parent):
            if stops_before == "log_batch":
                whole(self, run_id, metrics=named["metrics"][:2])
            written.append(run_id)
            raise KeyboardInterrupt
        return whole(self, run_id, *arguments, **named)

    name = "center · tiny · seed 1"
    metrics = {"seconds": 1.0, "recall.all.0.50": 70.0}
    monkeypatch.setattr(MlflowClient, stops_before, stop)

    def cut():
        nonlocal parent
        with SweepLog(uri, "demo", "k1", {"epochs": 3}) as log:
            parent = log.parent_run_id
            log.trial("t3", name, {"seed": 1}, metrics, CURVE)

    with pytest.raises(KeyboardInterrupt):
        cut()
    monkeypatch.undo()
    assert runs_of(uri)["demo"].info.status == "KILLED"
    assert runs_of(uri)[name].info.status == "RUNNING"

    again = {**metrics, "seconds": 9.0}  # measured anew
    with SweepLog(uri, "demo", "k1", {"epochs": 3}) as log:
        assert log.trial("t3", name, {"seed": 1}, again, CURVE)
    runs = runs_of(uri)
    assert len(runs) == 4
    assert runs[name].info.run_id == written[0]
    assert runs[name].info.status == "FINISHED"
    for metric, points in (("loss", 3), ("seconds", 1), ("recall.all.0.50", 1)):
        assert len(client(uri).get_metric_history(written[0], metric)) == points


def test_a_failed_trial_is_marked_and_may_succeed_later(uri):
    with SweepLog(uri, "demo", "k1", {}) as log:
        log.trial("t1", "line", {}, {}, error="ValueError: no box")
    failed = runs_of(uri)["line"]
    assert failed.info.status == "FAILED"
    assert failed.data.tags["lidarplace.error"] == "ValueError: no box"
    with SweepLog(uri, "demo", "k1", {}) as log:
        assert log.trial("t1", "line", {}, {"seconds": 1.0})
    run = runs_of(uri)["line"]
    assert run.info.run_id == failed.info.run_id
    assert run.info.status == "FINISHED"
    assert "lidarplace.error" not in run.data.tags


def test_an_exception_leaves_the_parent_failed(uri):
    with pytest.raises(RuntimeError), SweepLog(uri, "demo", "k1", {}):
        raise RuntimeError
    assert runs_of(uri)["demo"].info.status == "FAILED"


def test_more_params_and_metrics_than_one_batch_takes(uri):
    params = {f"p{i}": i for i in range(150)}
    metrics = {f"m{i}": float(i) for i in range(1100)}
    with SweepLog(uri, "demo", "k1", params) as log:
        log.trial("t1", "line", params, metrics)
    run = runs_of(uri)["line"]
    assert len(run.data.params) == 150
    assert run.data.metrics == metrics
    with SweepLog(uri, "demo", "k1", params) as log:
        assert not log.trial("t1", "line", params, metrics)


def test_two_sweeps_share_an_experiment(uri):
    log_two(uri, "k1")
    assert log_two(uri, "k2") == [True, True]


def test_mistakes_have_clear_errors(uri):
    with pytest.raises(
        ValueError, match=r"for example sqlite:///runs/mlflow.db .* found './mlruns'"
    ):
        SweepLog("./mlruns", "demo", "k1", {})
    with pytest.raises(ValueError, match="found 'file:mlruns'"):
        ui_command("file:mlruns")
    with pytest.raises(ValueError, match="sweep_key may have letters"):
        SweepLog(uri, "demo", "k'1", {})
    log_two(uri)
    with (
        pytest.raises(ValueError, match="has epochs = 3, now it is 4: a resumed sweep cannot"),
        SweepLog(uri, "demo", "k1", {"epochs": 4}),
    ):
        pass
    mlflow = client(uri)
    mlflow.delete_experiment(mlflow.get_experiment_by_name("demo").experiment_id)
    with pytest.raises(ValueError, match="'demo' was deleted"), SweepLog(uri, "demo", "k1", {}):
        pass


def test_the_command_opens_the_database_on_this_machine_only(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(ui_command("sqlite:///my runs/mlflow.db"))
    assert words[0] == "MLFLOW_DISABLE_TELEMETRY=true"
    assert words[2:5] == ["-m", "mlflow", "ui"]
    assert (
        words[words.index("--backend-store-uri") + 1] == f"sqlite:///{tmp_path}/my runs/mlflow.db"
    )
    assert words[words.index("--host") + 1] == "127.0.0.1"


def test_metrics_of_a_trial(made_up_run):
    run = RunFolder.read(made_up_run)
    rows = run.results[run.results["trial"] == "t000"]
    metrics = trial_metrics(rows, run.surrogates, "line", {})
    assert (
        metrics["AP_R40_3D.Car.0.70"]
        == rows.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")["value"].item()
    )
    s_mig = run.surrogates.query(
        "placement == 'line' and `class` == 'Pedestrian' and surrogate == 's_mig'"
    )
    assert metrics["surrogate.s_mig.Pedestrian"] == s_mig["value"].item()
    assert len(metrics) == len(rows) + 3 * 9
