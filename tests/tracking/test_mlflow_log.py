"""A sweep in MLflow: found again, continued, never logged twice."""

from __future__ import annotations

import shlex
import socket
import sys
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import requests
from mlflow_runs_of import (
    CURVE,
    assert_logged_once,
    log_trial,
    new_store,
    runs_of,
    until,
)

from lidarplace.files.secret_urls import public_url
from tracking.mlflow.connection import is_away
from tracking.mlflow.journal import Journal, RefusedEntry
from tracking.mlflow.log import SweepLog, trial_metrics, ui_command
from tracking.run_folders.sweep import RunFolder


@pytest.fixture
def uri(tmp_path) -> str:
    return new_store(tmp_path / "store")


def client(uri):
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def http_error(status):
    response = requests.Response()
    response.status_code = status
    return requests.HTTPError(response=response)


@pytest.fixture
def journal(tmp_path) -> Path:
    return tmp_path / "demo" / "mlflow.jsonl"


def log_two(uri, journal, key="k1"):
    with SweepLog(uri, "demo", key, {"epochs": 3}, journal=journal) as log:
        for seed in (1, 2):
            log_trial(log, seed)
    assert (log.undelivered, log.refused) == (0, 0)
    assert not journal.exists()


def test_a_sweep_is_a_parent_and_a_child_a_trial(uri, journal, tmp_path):
    figure = tmp_path / "report.html"
    figure.write_text("<p>report</p>")
    with SweepLog(uri, "demo", "k1", {"epochs": 3}, journal=journal) as log:
        metrics = {"seconds": 2.5, "recall.all.0.50": np.nan}
        log.trial("t1", "line · tiny · seed 1", {"seed": 1}, metrics, CURVE)
        log.artifact(figure)
    runs = runs_of(uri)
    parent, child = runs["demo"], runs["line · tiny · seed 1"]
    assert parent.data.params == {"epochs": "3"}
    assert child.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert child.data.metrics == {"seconds": 2.5, "loss": 1.5}
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    history = client(uri).get_metric_history(child.info.run_id, "loss")
    assert [(point.step, point.value) for point in history] == [(1, 3.0), (2, 2.0), (3, 1.5)]
    files = [path.name for path in (tmp_path / "store" / "artifacts").rglob("*.html")]
    assert files == ["report.html"]


def test_the_parent_runs_in_the_block(uri, journal):
    log_two(uri, journal)
    with SweepLog(uri, "demo", "k1", {"epochs": 3}, journal=journal) as log:
        until(lambda: not log.undelivered)
        assert runs_of(uri)["demo"].info.status == "RUNNING"


def test_a_resumed_sweep_doubles_nothing(uri, journal):
    log_two(uri, journal)
    before = runs_of(uri)
    log_two(uri, journal)
    assert_logged_once(uri, range(1, 3))
    assert {run.info.run_id for run in runs_of(uri).values()} == {
        run.info.run_id for run in before.values()
    }


@pytest.mark.parametrize("fails_in", ["create_run", "log_batch", "set_terminated"])
def test_a_trial_cut_half_way_is_continued(uri, journal, monkeypatch, fails_in):
    """The connection breaks when a call has been carried out, in part, and not been answered."""
    log_two(uri, journal)
    from mlflow import MlflowClient

    whole = getattr(MlflowClient, fails_in)
    said, broken = [], []

    def breaks(self, *arguments, **named):
        if broken:
            return whole(self, *arguments, **named)
        broken.append(fails_in)
        if fails_in == "log_batch":
            run_id, metrics, params, tags = arguments
            arguments = (run_id, metrics[:2], params, tags)
        whole(self, *arguments, **named)
        raise ConnectionError("reset by peer")

    with SweepLog(uri, "demo", "k1", {"epochs": 3}, journal=journal, say=said.append) as log:
        until(lambda: not log.undelivered)
        monkeypatch.setattr(MlflowClient, fails_in, breaks)
        log_trial(log, 3)
    assert broken
    assert len(said) == 2
    assert "is away, the sweep goes on, entries wait in" in said[0]
    assert "reset by peer" in said[0]
    assert said[1] == f"MLflow at {uri} is back"
    assert_logged_once(uri, range(1, 4))


def test_of_two_runs_of_a_trial_one_stays(uri, journal):
    """A server that answers too late may carry out a call that was given up and made again."""
    log_two(uri, journal)
    mlflow = client(uri)
    first = runs_of(uri)["line · tiny · seed 1"]
    tags = {k: v for k, v in first.data.tags.items() if k.startswith(("lidarplace", "mlflow.p"))}
    mlflow.create_run(first.info.experiment_id, 1, tags, first.info.run_name)
    log_two(uri, journal)
    assert runs_of(uri)["line · tiny · seed 1"].info.run_id == first.info.run_id


def test_of_two_parents_the_oldest_stays_and_has_all_trials(uri, journal):
    """The lost call was carried out late: what was made in its place has the trials."""
    log_two(uri, journal)
    mlflow = client(uri)
    second = runs_of(uri)["demo"]
    mine = {"lidarplace.sweep": "k1"}
    first = mlflow.create_run(second.info.experiment_id, 1, mine, "demo")
    log_two(uri, journal)
    runs = runs_of(uri)
    assert runs.pop("demo").info.run_id == first.info.run_id
    assert {run.data.tags["mlflow.parentRunId"] for run in runs.values()} == {first.info.run_id}
    assert mlflow.get_run(first.info.run_id).info.status == "FINISHED"
    assert mlflow.get_run(second.info.run_id).info.lifecycle_stage == "deleted"


def test_a_failed_trial_is_marked_and_may_succeed_later(uri, journal):
    with SweepLog(uri, "demo", "k1", {}, journal=journal) as log:
        log.trial("t1", "line", {}, {}, error="ValueError: no box")
    failed = runs_of(uri)["line"]
    assert failed.info.status == "FAILED"
    assert failed.data.tags["lidarplace.error"] == "ValueError: no box"
    with SweepLog(uri, "demo", "k1", {}, journal=journal) as log:
        log.trial("t1", "line", {}, {}, error="ValueError: no box")  # fails once more
        log.trial("t1", "line", {"seed": 1}, {"seconds": 1.0})
    run = runs_of(uri)["line"]
    assert run.info.run_id == failed.info.run_id
    assert run.info.status == "FINISHED"
    assert run.data.params == {"seed": "1"}
    assert "lidarplace.error" not in run.data.tags


@pytest.mark.parametrize(
    ("error", "status"), [(RuntimeError, "FAILED"), (KeyboardInterrupt, "KILLED")]
)
def test_an_exception_shows_at_the_parent(uri, journal, error, status):
    with pytest.raises(error), SweepLog(uri, "demo", "k1", {}, journal=journal):
        raise error
    assert runs_of(uri)["demo"].info.status == status


def test_more_params_and_metrics_than_one_batch_takes(uri, journal):
    params = {f"p{i}": i for i in range(150)}
    metrics = {f"m{i}": float(i) for i in range(1100)}
    for _ in range(2):
        with SweepLog(uri, "demo", "k1", params, journal=journal) as log:
            log.trial("t1", "line", params, metrics)
    run = runs_of(uri)["line"]
    assert len(run.data.params) == 150
    assert run.data.metrics == metrics


def test_what_mlflow_refuses_does_not_hold_up_the_rest(uri, journal):
    said = []
    with SweepLog(uri, "demo", "k1", {}, journal=journal, say=said.append) as log:
        log.trial("worse", "worse", {}, {"no such\nname": 1.0})
        log.trial("bad", "bad", {}, {}, error="ValueError: no box")
        log.trial("bad", "bad", {}, {"no such\nname": 1.0})
        log.artifact(journal.parent / "missing.html")
        log_trial(log, 1)
    assert (log.undelivered, log.refused) == (0, 3)
    assert [line.split(", kept in")[0] for line in said] == [
        "MLflow refuses 'worse'",
        "MLflow refuses 'bad'",
        "MLflow refuses 'artifact'",
    ]
    assert "Invalid value" in said[0]
    assert "missing.html is gone" in said[2]
    runs = runs_of(uri)
    assert runs["line · tiny · seed 1"].info.status == "FINISHED"
    assert runs["demo"].info.status == "FINISHED"
    assert runs["worse"].info.status == "FAILED"
    refused = [entry for entry in Journal(journal).entries if isinstance(entry, RefusedEntry)]
    assert [entry.entry.kind for entry in refused] == ["trial", "trial", "artifact"]
    # The cause was mended: the next driver delivers them, and the journal goes.
    journal.write_text(journal.read_text().replace("no such\\nname", "a name"))
    (journal.parent / "missing.html").touch()
    log_two(uri, journal, "k2")
    assert runs_of_key(uri, "k1")["bad"].data.metrics == {"a name": 1.0}


def test_artifacts_that_cannot_be_written_hold_up_nothing(uri, journal, tmp_path):
    root = tmp_path / "store" / "artifacts"
    root.write_text("a file where a folder should be")
    report = tmp_path / "report.html"
    report.write_text("<p>report</p>")
    said = []
    for seed in (1, 2):  # the second driver tries the artifact again, and goes on
        with SweepLog(uri, "demo", "k1", {}, journal=journal, say=said.append, patience_s=5) as log:
            log.artifact(report)
            log_trial(log, seed)
        assert (log.undelivered, log.refused) == (0, seed)
    assert_logged_once(uri, range(1, 3))
    assert len(said) == 3
    assert all(line.startswith("MLflow refuses 'artifact', kept in") for line in said)
    assert "Errno" in said[0]
    root.unlink()
    with SweepLog(uri, "demo", "k1", {}, journal=journal) as log:
        pass
    assert not journal.exists()
    assert [path.name for path in root.rglob("*.html")] == ["report.html"]


@pytest.mark.parametrize(
    ("error", "away"),
    [
        (PermissionError(13, "Permission denied"), False),
        (NotADirectoryError(20, "Not a directory"), False),
        (OSError(28, "No space left on device"), False),
        (ConnectionResetError(104, "reset by peer"), True),
        (TimeoutError("timed out"), True),
        (socket.gaierror(-2, "Name or service not known"), True),
        (requests.exceptions.ChunkedEncodingError("cut"), True),
        (http_error(403), True),
        (http_error(413), False),
    ],
)
def test_what_stops_an_artifact_for_a_while_and_what_for_good(error, away):
    assert is_away(error, "http://host:5000") == away


def test_an_artifact_that_is_gone_is_dropped_when_the_journal_is_opened(uri, journal, tmp_path):
    report = tmp_path / "report.html"
    report.write_text("<p>report</p>")
    with (
        answering(503) as address,
        SweepLog(address, "demo", "k1", {}, journal=journal, say=str, patience_s=0) as log,
    ):
        log.artifact(report)
        log_trial(log, 1)
    report.unlink()
    said = []
    with SweepLog(uri, "demo", "k1", {}, journal=journal, say=said.append) as log:
        pass
    assert said == [f"MLflow: {report} is gone, it is no longer logged"]
    assert (log.undelivered, log.refused) == (0, 0)
    assert not journal.exists()
    assert_logged_once(uri, range(1, 2))


def runs_of_key(uri, key):
    mlflow = client(uri)
    experiment = mlflow.get_experiment_by_name("demo")
    found = mlflow.search_runs([experiment.experiment_id], f"tags.`lidarplace.sweep` = '{key}'")
    return {run.info.run_name: run for run in found}


def test_two_sweeps_share_an_experiment(uri, journal):
    log_two(uri, journal, "k1")
    log_two(uri, journal, "k2")
    for key in ("k1", "k2"):
        assert len(runs_of_key(uri, key)) == 3


@contextmanager
def answering(status):
    """The address of a server that answers everything with this status."""

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(status)
            self.end_headers()

        do_POST = do_GET

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://me:s3cret@127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.parametrize("status", [429, 500, 502, 503])
def test_a_server_in_trouble_is_away(journal, status):
    said = []
    with (
        answering(status) as address,
        SweepLog(address, "demo", "k1", {}, journal=journal, say=said.append, patience_s=0) as log,
    ):
        log_trial(log, 1)
    assert log.undelivered == 3
    assert " is away, the sweep goes on, entries wait in " in said[0]
    assert "s3cret" not in "".join(said)
    kinds = [entry.kind for entry in Journal(journal).entries]
    assert kinds == ["sweep", "status", "trial", "status"]


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_server_that_will_not_have_the_sweep_is_a_mistake(journal, status):
    with (
        answering(status) as address,
        pytest.raises(ValueError, match=f"me:\\*\\*\\*@127.*{status}"),
        SweepLog(address, "demo", "k1", {}, journal=journal),
    ):
        pass
    assert not journal.exists()


def test_mistakes_have_clear_errors(uri, journal, tmp_path, monkeypatch):
    def opened(uri, key="k1", params=None):
        with SweepLog(uri, "demo", key, params or {}, journal=journal):
            pass

    with pytest.raises(
        ValueError, match=r"for example sqlite:///runs/mlflow.db .* found './mlruns'"
    ):
        opened("./mlruns")
    with pytest.raises(ValueError, match="found 'file:mlruns'"):
        ui_command("file:mlruns")
    with pytest.raises(ValueError, match="sweep_key may have letters"):
        opened(uri, "k'1")
    (tmp_path / "file").write_text("no database, and longer than a header of one " * 9)
    with pytest.raises(ValueError, match="file: file is not a database"):
        opened(f"sqlite:///{tmp_path}/file")
    with pytest.raises(ValueError, match=r"file/mlflow\.db: File exists"):
        opened(f"sqlite:///{tmp_path}/file/mlflow.db")
    with pytest.raises(ValueError, match=r"u:\*\*\*@host/db.*dialects:nosuch"):
        opened("nosuch://u:secret@host/db")
    with pytest.raises(ValueError, match=r"^http://a b:\*\*\*@:5000"):
        opened("http://a b:secret@:5000")
    monkeypatch.setitem(sys.modules, "psycopg2", None)
    with pytest.raises(ValueError, match=r"u:\*\*\*@h/db needs the package psycopg2: pip install"):
        opened("postgresql://u:secret@h/db")
    log_two(uri, journal)
    with pytest.raises(ValueError, match="has epochs = 3, now it is 4: a resumed sweep cannot"):
        opened(uri, params={"epochs": 4})
    mlflow = client(uri)
    mlflow.delete_experiment(mlflow.get_experiment_by_name("demo").experiment_id)
    with pytest.raises(ValueError, match="'demo' was deleted"):
        opened(uri)


def test_the_command_opens_the_database(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(ui_command("sqlite:///my runs/mlflow.db", "/#/experiments/1"))
    assert words == ["python", "-m", "tracking.dashboard", f"{tmp_path}/my runs/mlflow.db"]
    assert ui_command("http://host:5000/", "/#/experiments/1") == "http://host:5000/#/experiments/1"


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("sqlite:////runs/a:b@c.db", "sqlite:////runs/a:b@c.db"),
        ("http://host:5000", "http://host:5000"),
        ("https://me:s3cret@host:5000/x", "https://me:***@host:5000/x"),
        ("postgresql://me:s@cr/t@host:5432/db", "postgresql://me:***@host:5432/db"),
        ("postgresql://me@host/db?password=s3cret&x=1", "postgresql://me@host/db?password=***&x=1"),
    ],
)
def test_passwords_are_masked(uri, shown):
    assert public_url(uri) == shown
    assert shown.removeprefix("sqlite:///") in ui_command(uri).replace("+psycopg2", "")


def test_metrics_of_a_trial(made_up_run):
    run = RunFolder.read(made_up_run)
    rows = run.results[run.results["trial"] == "t000"]
    own = run.surrogates[run.surrogates["placement"] == "line"]
    metrics = trial_metrics(rows, own)
    assert (
        metrics["AP_R40_3D.Car.0.70"]
        == rows.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")["value"].item()
    )
    s_mig = run.surrogates.query(
        "placement == 'line' and `class` == 'Pedestrian' and surrogate == 's_mig'"
    )
    assert metrics["surrogate.s_mig.Pedestrian"] == s_mig["value"].item()
    assert len(metrics) == len(rows) + 3 * 9
