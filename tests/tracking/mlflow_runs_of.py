"""Runs that a tracking server has of a sweep, to compare with those that were logged."""

import os
import time
import urllib.request
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from tests.forked import Forked
from tests.mlflow_database import write_database
from tracking.mlflow.content import EndedTrial, ParentRun, TrialRun
from tracking.mlflow.log import SweepLog
from tracking.mlflow.uri import sqlite_uri

CURVE = pd.DataFrame({"epoch": [1, 2, 3], "metric": "loss", "value": [3.0, 2.0, 1.5]})


def new_store(folder: Path) -> str:
    """The URI of a new database in a new folder."""
    write_database(folder / "mlflow.db")
    return sqlite_uri(folder / "mlflow.db")


def trial(key: str, error: str | None = None, **content: Any) -> EndedTrial:
    """A trial whose run has its key as name, unless `content` says otherwise."""
    fields = {"name": key, "params": {}, "metrics": {}, "ended": 1_700_000_000_000} | content
    return EndedTrial(key, lambda: TrialRun(**fields), error)


def trial_of(seed: int, *files: Path) -> EndedTrial:
    fields = {"name": f"line · tiny · seed {seed}", "params": {"seed": seed, "detector": "tiny"}}
    fields["metrics"] = {"AP_R40_3D.Car.0.70": 60.0 + seed, "recall.all.0.50": float("nan")}
    return trial(f"t{seed}", **fields, curve=CURVE, files=files)


def logging(uri: str, folder: Path, trials: Sequence[EndedTrial] = (), **about: Any) -> SweepLog:
    """A log of the sweep `demo`, which `trials` have ended of.

    Args:
        about: of the parent run, `say` and `patience_s`.
    """
    log_options = {name: about.pop(name) for name in ("say", "patience_s") if name in about}
    parent = ParentRun(**{"key": "k1", "name": "demo", "params": {}} | about)
    log = SweepLog(uri, parent, folder=folder, **log_options)
    log.follow(lambda: trials)
    return log


def logged(uri: str, folder: Path, trials: Sequence[EndedTrial] = (), **about: Any) -> SweepLog:
    """The log after its block, in which nothing else happens."""
    with logging(uri, folder, trials, **about) as log:
        pass
    return log


def client(uri: str) -> Any:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def runs_of(uri: str, name: str = "demo") -> dict[str, Any]:
    """The runs of an experiment by name. Fails if two have one name."""
    experiment = client(uri).get_experiment_by_name(name)
    runs = client(uri).search_runs([experiment.experiment_id], max_results=1000)
    by_name = {run.info.run_name: run for run in runs}
    assert len(by_name) == len(runs)
    return by_name


def points_of(uri: str, run: Any) -> list[tuple[str, int, float]]:
    history = partial(client(uri).get_metric_history, run.info.run_id)
    points = (point for name in run.data.metrics for point in history(name))
    return sorted((point.key, point.step, point.value) for point in points)


def assert_logged_once(uri: str, seeds: range, name: str = "demo") -> None:
    """The parent and exactly one run for each `trial_of`."""
    runs = runs_of(uri, name)
    parent = runs.pop(name)
    assert parent.info.status == "FINISHED"
    assert set(runs) == {f"line · tiny · seed {seed}" for seed in seeds}
    for seed in seeds:
        run = runs[f"line · tiny · seed {seed}"]
        assert run.info.status == "FINISHED"
        assert run.data.params == {"seed": str(seed), "detector": "tiny"}
        assert run.data.tags["mlflow.parentRunId"] == parent.info.run_id
        losses = [("loss", 1, 3.0), ("loss", 2, 2.0), ("loss", 3, 1.5)]
        assert points_of(uri, run) == [("AP_R40_3D.Car.0.70", 0, 60.0 + seed), *losses]


def until(condition: Callable[[], bool]) -> None:
    """Wait for it, five minutes at most."""
    for _ in range(30_000):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("five minutes passed")


def start_server(store: str, port: int, folder: Path) -> Forked:
    """Start what `mlflow server` runs, on this machine, ready to answer."""
    environment = {"_MLFLOW_SERVER_FILE_STORE": store, "_MLFLOW_SERVER_SERVE_ARTIFACTS": "true"}
    environment["_MLFLOW_SERVER_ARTIFACT_ROOT"] = "mlflow-artifacts:/"
    environment["_MLFLOW_SERVER_ARTIFACT_DESTINATION"] = str(folder / "artifacts")
    run = f"import uvicorn; uvicorn.run('mlflow.server.fastapi_app:app', port={port})"
    log = folder / "server.log"
    server = Forked(["-c", run], folder, log, environment=os.environ | environment)
    for _ in range(1500):
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=5).close()
            return server
        except OSError:
            assert server.poll() is None, log.read_text()
            time.sleep(0.2)
    raise AssertionError(log.read_text())
