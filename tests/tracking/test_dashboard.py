"""The dashboard: MLflow's own server shows the runs of a sweep, as its page asks for them."""

import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
import requests
from typer.testing import CliRunner

from tests.forked import GUARD_S, free_port
from tests.tracking.mlflow_runs_of import logged, new_store, trial, until
from tracking.dashboard import app

COLUMNS = ["metrics.AP_R40_3D.Car.0.70", "metrics.seconds"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """A folder with the database of a sweep of three trials, and the folder of the sweep."""
    folder = tmp_path_factory.mktemp("runs")
    uri = new_store(folder / "store")
    (folder / "demo").mkdir()
    ended = []
    for name, ap in (("line", 61.5), ("center", 70.25), ("square", 65.0)):
        data = {"metrics": {"AP_R40_3D.Car.0.70": ap, "seconds": 9.0}, "tags": {"placement": name}}
        ended.append(trial(name, name=f"{name} · tiny · seed 1", **data))
    logged(uri, folder / "demo", ended, columns=COLUMNS)
    (folder / "demo" / "sweep.json").write_text(json.dumps({"name": "demo", "tracking_uri": uri}))
    return folder


@pytest.fixture(scope="module")
def address(runs):
    """Address of the server that the command becomes, which ends with it."""
    port = free_port()
    command = (
        f"from tracking.dashboard import app; app(['{runs}/store/mlflow.db', '--port={port}'])"
    )
    with subprocess.Popen([sys.executable, "-c", command], stdout=subprocess.PIPE) as server:
        line = server.stdout.readline().decode()
        address = f"http://127.0.0.1:{port}"
        assert line.startswith(f"{address}/#/experiments/")
        until(lambda: answers(address))
        yield address
        server.terminate()
        assert server.wait(GUARD_S) is not None
    assert not answers(address)


def answers(address):
    with suppress(requests.ConnectionError):
        return requests.get(f"{address}/health", timeout=GUARD_S).ok
    return False


def post(address, call, body):
    answer = requests.post(f"{address}/ajax-api/2.0/mlflow/{call}", json=body, timeout=GUARD_S)
    answer.raise_for_status()
    return answer.json()


def experiment(address):
    experiments = post(address, "experiments/search", {"max_results": 9})["experiments"]
    (demo,) = [one for one in experiments if one["name"] == "demo"]
    return demo


def test_the_page_gets_the_runs_in_the_order_of_its_view(address):
    demo = experiment(address)
    tags = {tag["key"]: tag["value"] for tag in demo["tags"]}
    view = json.loads(tags["mlflow.sharedViewState.lidarplace"])
    order = f"{view['orderByKey']} {'ASC' if view['orderByAsc'] else 'DESC'}"
    body = {"experiment_ids": [demo["experiment_id"]], "order_by": [order]}
    body["filter"] = "tags.placement != 'square'"
    runs_of_page = post(address, "runs/search", body)["runs"]
    names = [run["info"]["run_name"] for run in runs_of_page]
    assert names == ["center · tiny · seed 1", "line · tiny · seed 1"]
    metrics = {metric["key"]: metric["value"] for metric in runs_of_page[0]["data"]["metrics"]}
    assert [metrics[name.split(".", 1)[1]] for name in COLUMNS] == [70.25, 9.0]
    assert [view["selectedColumns"][0]] == ["metrics.`AP_R40_3D.Car.0.70`"]


def dashboard(*words):
    return CliRunner().invoke(app, list(map(str, words)), catch_exceptions=False)


def test_of_a_server_the_address_is_printed(address):
    result = dashboard(address)
    number = experiment(address)["experiment_id"]
    assert result.exit_code == 0, result.stderr
    assert result.stdout.startswith(f"{address}/#/experiments/{number}/runs?viewStateShareKey=")


def test_mistakes_are_one_line(runs, monkeypatch):
    monkeypatch.chdir(runs)
    (runs / "text.db").write_text("no database, and longer than a header of one " * 9)
    (runs / "empty.db").touch()
    port = free_port()
    for where, message in (
        ("text.db", "file is not a database; restore a copy, or move the file away: the next run"),
        ("empty.db", "empty.db: an empty file"),
        ("nosuch://u:secret@host/db", "u:***@host/db"),
        (f"http://u:secret@127.0.0.1:{port}", "refused"),
    ):
        result = dashboard(where)
        assert result.exit_code == 2, result.stderr
        assert result.stderr.count("\n") == 1
        assert message in result.stderr
        assert "secret" not in result.stderr


def test_a_port_of_somebody_elses_server_is_refused(address, runs):
    port = address.rpartition(":")[2]
    result = dashboard(runs / "demo", "--port", port)
    output = result.exit_code, result.stdout, result.stderr
    assert output == (2, "", f"--port {port}: Address already in use\n")
