"""A sweep in MLflow: found again, completed, never logged twice."""

import shlex
import socket
import sys
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread

import numpy as np
import pytest
import requests

from tests.refused import refused
from tests.tracking.mlflow_runs_of import (
    CURVE,
    assert_logged_once,
    client,
    logged,
    logging,
    runs_of,
    trial,
    trial_of,
    until,
)
from tracking.mlflow import log as mlflow_log
from tracking.mlflow.connection import is_away
from tracking.mlflow.content import EndedTrial
from tracking.mlflow.uri import ui_command


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    monkeypatch.setattr(mlflow_log, "LOOK_S", 0.02)
    monkeypatch.setattr(mlflow_log, "FIRST_PAUSE_S", 0.01)


def http_error(status):
    response = requests.Response()
    response.status_code = status
    return requests.HTTPError(response=response)


def log_two(uri, folder, **about):
    log = logged(uri, folder, [trial_of(1), trial_of(2)], params={"epochs": 3}, **about)
    assert (log.undelivered, log.refused) == (0, 0)


def test_a_sweep_is_a_parent_and_a_child_a_trial(uri, tmp_path):
    (figure := tmp_path / "report.html").write_text("<p>report</p>")
    metrics = {"seconds": 2.5, "recall.all.0.50": np.nan}
    one = trial("t1", name="line", params={"seed": 1}, metrics=metrics, curve=CURVE, ended=10_000)
    with logging(uri, tmp_path, [one], params={"epochs": 3}) as log:
        log.artifact(figure)
    runs = runs_of(uri)
    parent, child = runs["demo"], runs["line"]
    assert parent.data.params == {"epochs": "3"}
    assert child.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert child.data.metrics == {"seconds": 2.5, "loss": 1.5}
    assert (child.info.start_time, child.info.end_time) == (7500, 10_000)
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    history = client(uri).get_metric_history(child.info.run_id, "loss")
    assert [(point.step, point.value) for point in history] == [(1, 3.0), (2, 2.0), (3, 1.5)]
    files = [path.name for path in (tmp_path / "store" / "artifacts").rglob("*.html")]
    assert files == ["report.html"]


def test_the_parent_runs_in_the_block_and_trials_are_seen_as_they_end(uri, tmp_path):
    log_two(uri, tmp_path)
    ended = [trial_of(1), trial_of(2)]
    with logging(uri, tmp_path, ended, params={"epochs": 3}):
        assert runs_of(uri)["demo"].info.status == "RUNNING"
        ended.append(trial_of(3))
        until(lambda: "line · tiny · seed 3" in runs_of(uri))
        assert runs_of(uri)["demo"].info.status == "RUNNING"
    assert_logged_once(uri, range(1, 4))


def test_a_resumed_sweep_doubles_nothing_and_asks_for_nothing_that_is_there(uri, tmp_path):
    log_two(uri, tmp_path)
    before = runs_of(uri)
    requests = []
    again = [EndedTrial(f"t{seed}", lambda: requests.append(1)) for seed in (1, 2)]
    logged(uri, tmp_path, again, params={"epochs": 3})
    assert not requests
    assert_logged_once(uri, range(1, 3))
    ids = [{run.info.run_id for run in runs.values()} for runs in (runs_of(uri), before)]
    assert ids[0] == ids[1]


@pytest.mark.parametrize("fails_in", ["create_run", "log_batch", "log_artifact", "set_terminated"])
def test_a_trial_cut_half_way_is_continued(uri, tmp_path, monkeypatch, fails_in):
    """The connection breaks when a call has been carried out, in part, and not been answered."""
    (picture := tmp_path / "placement.png").write_bytes(b"a picture")
    log_two(uri, tmp_path)
    from mlflow import MlflowClient

    whole = getattr(MlflowClient, fails_in)
    messages, broken = [], []

    def breaks(self, *arguments, **named):
        if broken:
            return whole(self, *arguments, **named)
        broken.append(fails_in)
        if fails_in == "log_batch":
            run_id, metrics, params, tags = arguments
            arguments = (run_id, metrics[:2], params, tags)
        if fails_in != "log_artifact":
            whole(self, *arguments, **named)
        raise ConnectionError("reset by peer")

    ended = []
    with logging(uri, tmp_path, ended, params={"epochs": 3}, say=messages.append):
        monkeypatch.setattr(MlflowClient, fails_in, breaks)
        ended.append(trial_of(3, picture))
    assert broken
    run = runs_of(uri)["line · tiny · seed 3"]
    assert [file.path for file in client(uri).list_artifacts(run.info.run_id)] == ["placement.png"]
    away = f"MLflow at {uri} is unreachable, the sweep continues: reset by peer"
    assert messages == [away, f"MLflow at {uri} is back"]
    assert_logged_once(uri, range(1, 4))


def test_of_two_runs_of_a_trial_one_stays(uri, tmp_path):
    """A server that answers too late may carry out a call that was given up and made again."""
    log_two(uri, tmp_path)
    mlflow = client(uri)
    first = runs_of(uri)["line · tiny · seed 1"]
    tags = {k: v for k, v in first.data.tags.items() if k.startswith(("lidarplace", "mlflow.p"))}
    mlflow.create_run(first.info.experiment_id, 1, tags, first.info.run_name)
    log_two(uri, tmp_path)
    assert runs_of(uri)["line · tiny · seed 1"].info.run_id == first.info.run_id


def test_of_two_parents_the_oldest_stays_and_has_all_trials(uri, tmp_path):
    """The lost call was carried out late: what was made in its place has the trials."""
    log_two(uri, tmp_path)
    mlflow = client(uri)
    second = runs_of(uri)["demo"]
    first = mlflow.create_run(second.info.experiment_id, 1, {"lidarplace.sweep": "k1"}, "demo")
    log_two(uri, tmp_path)
    runs = runs_of(uri)
    assert runs.pop("demo").info.run_id == first.info.run_id
    assert {run.data.tags["mlflow.parentRunId"] for run in runs.values()} == {first.info.run_id}
    assert mlflow.get_run(first.info.run_id).info.status == "FINISHED"
    assert mlflow.get_run(second.info.run_id).info.lifecycle_stage == "deleted"


def test_a_failed_trial_is_marked_and_may_succeed_later(uri, tmp_path):
    reason = "ValueError: no box" + 6000 * "!"
    for _ in range(2):
        logged(uri, tmp_path, [trial("line", reason)])
        failed = runs_of(uri)["line"]
        assert failed.info.status == "FAILED"
        assert failed.data.tags["lidarplace.error"] == reason[:5000]
    logged(uri, tmp_path, [trial("line", "another", metrics={"surrogate": 2.0})])
    assert runs_of(uri)["line"].data.tags["lidarplace.error"] == "another"
    good = trial("line", params={"seed": 1}, metrics={"seconds": 1.0, "surrogate": 2.5})
    logged(uri, tmp_path, [good])
    run = runs_of(uri)["line"]
    assert run.info.run_id == failed.info.run_id
    assert run.info.status == "FINISHED"
    assert run.info.end_time - run.info.start_time == 1000
    assert run.data.params == {"seed": "1"}
    assert "lidarplace.error" not in run.data.tags
    assert run.data.metrics == {"seconds": 1.0, "surrogate": 2.0}, "one value each, the first"
    logged(uri, tmp_path, [trial("line", "no more")])  # what is finished stays
    assert runs_of(uri)["line"].info.status == "FINISHED"


@pytest.mark.parametrize(
    ("error", "status"), [(RuntimeError, "FAILED"), (KeyboardInterrupt, "KILLED")]
)
def test_an_exception_shows_at_the_parent(uri, tmp_path, error, status):
    with pytest.raises(error), logging(uri, tmp_path, [trial_of(1)]):
        raise error
    runs = runs_of(uri)
    assert runs["demo"].info.status == status
    assert runs["line · tiny · seed 1"].info.status == "FINISHED"


def test_more_params_and_metrics_than_one_batch_takes(uri, tmp_path):
    params = {f"p{i}": i for i in range(150)}
    metrics = {f"m{i}": float(i) for i in range(1100)}
    for _ in range(2):
        logged(uri, tmp_path, [trial("line", params=params, metrics=metrics)], params=params)
    run = runs_of(uri)["line"]
    assert len(run.data.params) == 150
    assert run.data.metrics == metrics


def test_what_mlflow_refuses_does_not_hold_up_the_rest_and_is_tried_again(uri, tmp_path):
    messages = []
    bad = {"no such\nname": 1.0}
    logged(uri, tmp_path, [trial("bad", "ValueError: no box")])
    ended = [trial("worse", metrics=bad), trial("bad", metrics=bad), trial_of(1)]
    with logging(uri, tmp_path, ended, say=messages.append) as log:
        log.artifact(tmp_path / "missing.html")
    assert (log.undelivered, log.refused) == (0, 3)
    refusals = [line.split(", the same command tries again: ")[0] for line in messages]
    names = ("worse", "bad", tmp_path / "missing.html")
    assert refusals == [f"MLflow refuses '{name}'" for name in names]
    assert "Invalid value" in messages[0]
    assert "missing.html: no such file" in messages[2]
    runs = runs_of(uri)
    assert runs["line · tiny · seed 1"].info.status == "FINISHED"
    assert runs["demo"].info.status == "FINISHED"
    assert runs["worse"].info.status == "FAILED"
    assert "Invalid value" in runs["worse"].data.tags["lidarplace.refused"]
    # The cause was mended.
    good = {"a name": 1.0}
    ended = [trial("worse", metrics=good), trial("bad", metrics=good), trial_of(1)]
    log = logged(uri, tmp_path, ended)
    assert (log.undelivered, log.refused) == (0, 0)
    runs = runs_of(uri)
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    for name in ("worse", "bad"):
        assert runs[name].data.metrics == good
        assert not {"lidarplace.refused", "lidarplace.error"} & set(runs[name].data.tags)


def test_artifacts_that_cannot_be_written_hold_up_nothing(uri, tmp_path):
    (root := tmp_path / "store" / "artifacts").write_text("a file where a folder should be")
    (report := tmp_path / "report.html").write_text("<p>report</p>")
    (picture := tmp_path / "placement.png").write_bytes(b"a picture")
    drawn = trial("drawn", files=[picture], metrics={"seconds": 1.0})
    messages = []
    for seeds in ([1], [1, 2]):  # the second driver tries the artifacts again, and goes on
        ended = [drawn, *map(trial_of, seeds)]
        with logging(uri, tmp_path, ended, say=messages.append, patience_s=5) as log:
            log.artifact(report)
        assert (log.undelivered, log.refused) == (0, 2)
    runs = runs_of(uri)
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    assert runs["drawn"].data.metrics == {"seconds": 1.0}
    assert "Errno" in runs["drawn"].data.tags["lidarplace.refused"]
    assert len(messages) == 4
    assert all(line.startswith("MLflow refuses ") for line in messages)
    assert "Errno" in messages[0]
    root.unlink()
    with logging(uri, tmp_path, ended) as log:
        log.artifact(report)
    assert (log.undelivered, log.refused) == (0, 0)
    assert sorted(path.name for path in root.rglob("*.*")) == ["placement.png", "report.html"]
    run = runs_of(uri)["drawn"]
    assert "lidarplace.refused" not in run.data.tags
    assert run.data.metrics == {"seconds": 1.0}


def test_a_trial_that_cannot_be_told_ends_the_sweep_and_no_other(uri, tmp_path):
    def tell():
        raise FileNotFoundError("the result is gone")

    log = logging(uri, tmp_path, [trial_of(1), EndedTrial("gone", tell)])

    def held():
        with log:
            until(lambda: log._broken is not None)
            with pytest.raises(FileNotFoundError):
                log.hold()

    with pytest.raises(FileNotFoundError):
        held()
    assert runs_of(uri)["demo"].info.status == "FAILED"
    logged(uri, tmp_path, [trial_of(1)])
    assert_logged_once(uri, range(1, 2))


def test_nobody_is_asked_while_the_log_is_held(uri, tmp_path):
    begun, requests = Event(), []

    def ended():
        requests.append(1)
        begun.set()
        return [trial_of(1)]

    with logging(uri, tmp_path) as log:
        log.follow(ended)
        assert begun.wait(60)
        log.hold()
        before = len(requests)
        log.artifact(tmp_path / "missing.html")
        until(lambda: log.refused == 1)  # a look without a question
        assert len(requests) == before
    assert len(requests) > before


def test_what_stops_an_artifact_for_a_while_and_what_for_good():
    lasting = [PermissionError(13, "Permission denied"), NotADirectoryError(20, "Not a directory")]
    lasting += [OSError(28, "No space left on device"), http_error(413)]
    assert not any(is_away(error, "http://host:5000") for error in lasting)
    away = [ConnectionResetError(104, "reset by peer"), TimeoutError("timed out"), http_error(403)]
    away += [socket.gaierror(-2, "Name or service not known")]
    away += [requests.exceptions.ChunkedEncodingError("cut")]
    assert all(is_away(error, "http://host:5000") for error in away)


def test_two_sweeps_share_an_experiment(uri, tmp_path):
    log_two(uri, tmp_path, key="k1")
    log_two(uri, tmp_path, key="k2")
    mlflow = client(uri)
    experiment = mlflow.get_experiment_by_name("demo").experiment_id
    for key in ("k1", "k2"):
        experiment_runs = mlflow.search_runs([experiment], f"tags.`lidarplace.sweep` = '{key}'")
        assert len({run.info.run_name for run in experiment_runs}) == len(experiment_runs) == 3


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


@pytest.mark.parametrize("status", [429, 500])
def test_a_server_in_trouble_is_away(tmp_path, status):
    messages = []
    with (
        answering(status) as address,
        logging(address, tmp_path, [trial_of(1)], say=messages.append, patience_s=0.1) as log,
    ):
        log.artifact(tmp_path / "report.html")
    assert log.undelivered == 3
    assert " is unreachable, the sweep continues: " in messages[0]
    assert messages[1:] == ["MLflow has not got 3 runs or files; the same command delivers them"]
    assert "s3cret" not in "".join(messages)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_server_that_will_not_have_the_sweep_is_a_mistake(tmp_path, status):
    with (
        answering(status) as address,
        pytest.raises(ValueError, match=f"me:\\*\\*\\*@127.*{status}"),
        logging(address, tmp_path),
    ):
        pass


def test_a_server_that_does_not_answer_holds_up_nothing(tmp_path, monkeypatch):
    """The server takes the connection, and that is all."""
    monkeypatch.setattr(mlflow_log, "_OPENS_WITHIN_S", 0.1)
    messages = []
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        address = f"http://127.0.0.1:{listener.getsockname()[1]}"
        log = logged(address, tmp_path, [trial_of(1)], say=messages.append, patience_s=0.1)
    assert log.undelivered == 2
    assert [line.partition(": ")[2] for line in messages[:1]] == ["no answer for 0.1 s"]
    assert messages[1].startswith("MLflow has not got 2 runs")


def test_mistakes_have_clear_errors(uri, tmp_path, monkeypatch):
    def opened(uri, **about):
        logged(uri, tmp_path, **about)

    with refused(("", "", "'./mlruns'")):
        opened("./mlruns")
    with refused(("", "", "'file:mlruns'")):
        ui_command("file:mlruns")
    with refused(("", "key", "k'1")):
        opened(uri, key="k'1")
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
    with refused(r"u:\*\*\*@h/db: needs the package psycopg2: pip install"):
        opened("postgresql://u:secret@h/db")
    log_two(uri, tmp_path)
    with refused("epochs: .*expected 3, found 4"):
        opened(uri, params={"epochs": 4})
    mlflow = client(uri)
    mlflow.delete_experiment(mlflow.get_experiment_by_name("demo").experiment_id)
    with refused("experiment 'demo': "):
        opened(uri)


def test_the_command_opens_the_database(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(ui_command("sqlite:///my runs/mlflow.db", "/#/experiments/1"))
    assert words == ["lidarplace", "dashboard", f"{tmp_path}/my runs/mlflow.db"]
    assert ui_command("http://host:5000/", "/#/experiments/1") == "http://host:5000/#/experiments/1"
    for uri in ("https://me:s3cret@host:5000/x", "postgresql://me@host/db?password=s3cret&x=1"):
        assert "s3cret" not in ui_command(uri)
