"""Content of MLflow's runs beside metrics: tags, data, pictures, samples, the page."""

import json
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest

import tracking
from tests.tracking.mlflow_runs_of import client, logged, logging, runs_of, trial, until
from tracking.mlflow.content import Dataset
from tracking.mlflow.experiment_page import VIEW_TAG, source_tags

SOURCE = {"source": {"scene": "sumo-1"}, "profile": {"frames": 9}}
DATA = [
    Dataset(name=f"sumo-1 {context}", digest=digest, context=context, **SOURCE)
    for context, digest in (("train", "0a1b"), ("test", "2c3d"))
]


@pytest.fixture
def picture(tmp_path) -> Path:
    (path := tmp_path / "placement.png").write_bytes(b"a picture")
    return path


def drawn(picture, key="t1"):
    return trial(key, tags={"seed": 1}, datasets=DATA, files=[picture])


def artifacts(uri, run):
    return [file.path for file in client(uri).list_artifacts(run.info.run_id)]


def test_a_trial_has_tags_data_and_pictures(uri, tmp_path, picture):
    tags = {"mlflow.source.name": "run.py"}
    for _ in range(2):
        logged(uri, tmp_path, [drawn(picture)], tags=tags, note="**Run** again")
    runs = runs_of(uri)
    parent, child = runs["demo"], runs["t1"]
    assert parent.data.tags["mlflow.note.content"] == "**Run** again"
    assert parent.data.tags["mlflow.source.name"] == "run.py"
    assert child.data.tags.items() >= {"seed": "1", "mlflow.source.name": "run.py"}.items()
    inputs = [(entry.tags[0].value, entry.dataset) for entry in child.inputs.dataset_inputs]
    digests = {context: (data.name, data.digest) for context, data in inputs}
    assert digests == {"train": ("sumo-1 train", "0a1b"), "test": ("sumo-1 test", "2c3d")}
    assert artifacts(uri, child) == ["placement.png"]
    assert artifacts(uri, parent) == []


def test_a_trial_cut_before_its_picture_gets_it_and_has_its_data_once(uri, tmp_path, picture):
    logged(uri, tmp_path, [trial("t1", tags={"seed": 1}, datasets=DATA)])
    run = runs_of(uri)["t1"]
    client(uri).update_run(run.info.run_id, status="RUNNING")
    logged(uri, tmp_path, [drawn(picture)])
    run = runs_of(uri)["t1"]
    assert run.info.status == "FINISHED"
    assert artifacts(uri, run) == ["placement.png"]
    assert len(run.inputs.dataset_inputs) == 2


def test_system_metrics_go_on_after_a_stop_and_come_once(uri, tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL", "0.05")

    def steps():
        run = runs_of(uri)["demo"].info.run_id
        history = client(uri).get_metric_history(run, "system/cpu_utilization_percentage")
        return [point.step for point in history]

    for least in (2, 4):
        with logging(uri, tmp_path):
            until(lambda least=least: len(steps()) >= least)
        assert steps() == list(range(len(steps())))


def test_the_view_of_the_page_is_the_experiments(uri, tmp_path):
    columns = ["metrics.AP_R40_3D.Car.0.70", "params.scene.density"]
    of_page = {"columns": columns[::-1], "order_by": columns[0], "about": "What it is"}
    chart = ("metrics.surrogate.s_mig.Car", columns[0])
    with logging(uri, tmp_path, **of_page, ascending=True, chart=chart) as log:
        page = log.page()
    experiment = client(uri).get_experiment_by_name("demo")
    parent = runs_of(uri)["demo"].info.run_id
    begin = f"/#/experiments/{experiment.experiment_id}/runs?viewStateShareKey=lidarplace"
    assert page.startswith(begin)
    state = json.loads(experiment.tags[VIEW_TAG])
    assert state["selectedColumns"][0] == "params.`scene.density`"
    assert state["orderByKey"] == "metrics.`AP_R40_3D.Car.0.70`"
    assert (state["runsExpanded"], state["orderByAsc"]) == ({parent: True}, True)
    assert experiment.tags["mlflow.note.content"] == "What it is"
    (card,), (section,) = state["compareRunCharts"], state["compareRunSections"]
    assert card["metricSectionId"] == section["uuid"]
    assert (card["xaxis"]["key"], card["yaxis"]["key"]) == tuple(c[8:] for c in chart)


def git(folder, *words):
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", "-C", folder, *identity, *words], check=True, capture_output=True)


def test_in_a_checkout_the_commit_and_whether_files_differ(tmp_path, monkeypatch):
    monkeypatch.setattr(tracking, "__path__", [str(tmp_path / "tracking")])
    tags = source_tags()
    assert tags["lidarplace.version"] == version("lidarplace")
    assert tags["mlflow.source.type"] == "LOCAL"
    assert tags["mlflow.source.name"]
    assert tags["mlflow.user"]
    assert not [name for name in tags if "git" in name]

    (tmp_path / "code.py").write_text("x = 1\n")
    git(tmp_path, "init")
    git(tmp_path, "add", "code.py")
    assert not [name for name in source_tags() if "git" in name], "there is no commit yet"
    git(tmp_path, "commit", "-m", "code")
    tags = source_tags()
    assert len(tags["mlflow.source.git.commit"]) == 40
    assert tags["mlflow.source.git.dirty"] == "false"
    (tmp_path / "code.py").write_text("x = 2\n")
    assert source_tags()["mlflow.source.git.dirty"] == "true"
