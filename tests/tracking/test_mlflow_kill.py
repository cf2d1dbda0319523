"""A driver killed between any two statements of the log, and the next one that goes on."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import sqlite3
from pathlib import Path

from mlflow_runs_of import assert_logged_once, log_trial, new_store, runs_of

from tracking.mlflow import journal as journal_module
from tracking.mlflow.log import SweepLog

SEEDS = range(1, 5)
KILLS = 5


def log_all(uri: str, journal: Path) -> None:
    with SweepLog(uri, "demo", "k1", {"epochs": 3}, journal=journal) as log:
        for seed in SEEDS:
            log_trial(log, seed)
        log.sample({"system/cpu_utilization_percentage": 50.0})
        log.artifact(journal.parent / "report.html")
        log.model("t1", "tiny", journal.parent / "model", {"AP": 61.0})


def killed_driver(uri: str, journal: Path, steps: int) -> None:
    """Log the sweep, and kill this process at a step: before a statement of SQL or after a sync."""
    from sqlalchemy import event
    from sqlalchemy.engine import Engine

    left = steps

    def step(*_: object) -> None:
        nonlocal left
        left -= 1
        if not left:
            os.kill(os.getpid(), signal.SIGKILL)

    sync = os.fsync

    def synced(file: int) -> None:
        sync(file)
        step()

    journal_module.os.fsync = synced
    event.listen(Engine, "before_cursor_execute", step)
    event.listen(Engine, "commit", step)
    log_all(uri, journal)


def test_a_driver_killed_anywhere_loses_and_doubles_nothing(tmp_path):
    from mlflow import MlflowClient

    uri = new_store(tmp_path / "store")
    processes = multiprocessing.get_context("forkserver")
    # What takes seconds to import, once for all drivers.
    heavy = ["mlflow.store.tracking.sqlalchemy_store", "mlflow.tracking", "tracking.mlflow.log"]
    processes.set_forkserver_preload(heavy)
    journal = tmp_path / "demo" / "mlflow.jsonl"
    journal.parent.mkdir()
    (journal.parent / "report.html").write_text("<p>report</p>")
    (journal.parent / "model").mkdir()
    (journal.parent / "model" / "MLmodel").write_text("flavors: {}")
    chance = random.Random(6)
    for _ in range(KILLS):
        driver = processes.Process(
            target=killed_driver, args=(uri, journal, chance.randrange(1, 120))
        )
        driver.start()
        driver.join(120)
        assert driver.exitcode == -signal.SIGKILL
    log_all(uri, journal)
    assert_logged_once(uri, SEEDS)
    assert runs_of(uri)["demo"].data.params == {"epochs": "3"}
    assert not journal.exists()
    files = [path.name for path in (tmp_path / "store" / "artifacts").rglob("*.html")]
    assert files == ["report.html"]
    mlflow = MlflowClient(tracking_uri=uri)
    (model,) = mlflow.search_logged_models([runs_of(uri)["demo"].info.experiment_id])
    assert (model.status.value, model.tags["lidarplace.best"]) == ("READY", "true")
    with sqlite3.connect(uri.removeprefix("sqlite:///")) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
