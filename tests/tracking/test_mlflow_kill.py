"""A driver killed anywhere in the log, and the next one that goes on."""

import multiprocessing
import os
import random
import signal
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.forked import free_port
from tests.tracking import mlflow_runs_of as made
from tracking.mlflow.uri import sqlite_file

SEEDS = range(1, 5)
KILLS = 5


def log_all(uri: str, folder: Path) -> None:
    ended = [made.trial_of(seed, folder / "placement.png") for seed in SEEDS]
    with made.logging(uri, folder, ended, params={"epochs": 3}) as log:
        log.artifact(folder / "report.html")


def killed_driver(uri: str, folder: Path, steps: int) -> None:
    """Log the sweep, and kill this process at a step: a statement of SQL, or a request."""
    import requests
    from sqlalchemy import event
    from sqlalchemy.engine import Engine

    left = steps

    def step(*_: object) -> None:
        nonlocal left
        left -= 1
        if not left:
            os.kill(os.getpid(), signal.SIGKILL)

    send = requests.Session.send

    def sent(*arguments: object, **named: object) -> object:
        step()
        answer = send(*arguments, **named)
        step()
        return answer

    requests.Session.send = sent
    event.listen(Engine, "before_cursor_execute", step)
    event.listen(Engine, "commit", step)
    log_all(uri, folder)


@contextmanager
def served(store: str, folder: Path) -> Iterator[str]:
    port = free_port()
    server = made.start_server(store, port, folder)
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        server.kill()
        server.wait(60)


# Of all steps of a driver, and of those of one that finds nothing missing.
@pytest.mark.parametrize(("through", "first", "further"), [("sqlite", 300, 80), ("server", 55, 20)])
def test_a_driver_killed_anywhere_loses_and_doubles_nothing(tmp_path, through, first, further):
    store = made.new_store(tmp_path / "store")
    limits = [first] + [further] * (KILLS - 1)
    if through == "sqlite":
        killed_often(store, store, tmp_path, limits)
    else:
        with served(store, tmp_path) as address:
            killed_often(address, store, tmp_path, limits)


def killed_often(uri: str, store: str, folder: Path, limits: Sequence[int]) -> None:
    processes = multiprocessing.get_context("forkserver")
    # What takes seconds to import, once for all drivers.
    heavy = ["mlflow.store.tracking.sqlalchemy_store", "mlflow.tracking", "tracking.mlflow.log"]
    processes.set_forkserver_preload(heavy)
    (run := folder / "demo").mkdir()
    (run / "report.html").write_text("<p>report</p>")
    (run / "placement.png").write_bytes(b"a picture")
    chance = random.Random(3)  # the first driver dies in the middle of a trial
    for limit in limits:
        step = chance.randrange(1, limit)
        driver = processes.Process(target=killed_driver, args=(uri, run, step))
        driver.start()
        driver.join(240)
        assert driver.exitcode == -signal.SIGKILL
    log_all(uri, run)
    made.assert_logged_once(store, SEEDS)
    assert made.runs_of(store)["demo"].data.params == {"epochs": "3"}
    files = sorted(path.name for path in folder.rglob("artifacts/**/*.*"))
    assert files == len(SEEDS) * ["placement.png"] + ["report.html"]
    with sqlite3.connect(sqlite_file(store)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
