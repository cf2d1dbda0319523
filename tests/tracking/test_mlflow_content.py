"""What a team finds in MLflow beside metrics: tags, data, pictures, samples, models, the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mlflow_runs_of import new_store, runs_of, until

from tracking.mlflow.journal import Dataset, Journal, SampleEntry, TrialEntry
from tracking.mlflow.log import SweepLog
from tracking.mlflow.page import VIEW_TAG

DATA = [
    Dataset(
        name=f"sumo-1 {context}",
        digest=digest,
        context=context,
        source={"scene": "sumo-1"},
        profile={"frames": 9},
    )
    for context, digest in (("train", "0a1b"), ("test", "2c3d"))
]


@pytest.fixture
def uri(tmp_path) -> str:
    return new_store(tmp_path / "store")


@pytest.fixture
def journal(tmp_path) -> Path:
    return tmp_path / "demo" / "mlflow.jsonl"


@pytest.fixture
def picture(tmp_path) -> Path:
    path = tmp_path / "placement.png"
    path.write_bytes(b"a picture")
    return path


def client(uri):
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def opened(uri, journal, **about):
    return SweepLog(uri, "demo", "k1", {}, journal=journal, **about)


def log_trial(log, picture, key="t1"):
    log.trial(key, key, {}, {}, tags={"seed": 1}, datasets=DATA, files=[picture])


def artifacts(uri, run):
    return [file.path for file in client(uri).list_artifacts(run.info.run_id)]


def test_a_trial_has_tags_data_and_pictures(uri, journal, picture):
    tags = {"mlflow.source.name": "run.py"}
    for _ in range(2):
        with opened(uri, journal, tags=tags, note="**Run** again") as log:
            log_trial(log, picture)
    runs = runs_of(uri)
    parent, child = runs["demo"], runs["t1"]
    assert parent.data.tags["mlflow.note.content"] == "**Run** again"
    assert parent.data.tags["mlflow.source.name"] == "run.py"
    assert child.data.tags.items() >= {"seed": "1", "mlflow.source.name": "run.py"}.items()
    found = {
        given.tags[0].value: (given.dataset.name, given.dataset.digest)
        for given in child.inputs.dataset_inputs
    }
    assert found == {"train": ("sumo-1 train", "0a1b"), "test": ("sumo-1 test", "2c3d")}
    assert artifacts(uri, child) == ["placement.png"]
    assert artifacts(uri, parent) == []


def test_a_driver_killed_before_the_picture_arrived_loses_none(uri, journal, picture):
    """The journal has the trial, MLflow has its run, and nobody sent the picture."""
    with opened(uri, journal):
        pass
    entry = TrialEntry(
        sweep="k1",
        key="t1",
        run_name="t1",
        time=1,
        params={},
        points=(),
        error=None,
        datasets=DATA,
        files=(str(picture),),
    )
    lines = Journal(journal)
    lines.append(entry)
    with opened(uri, journal) as log:
        own = log._runs["k1"]
        until(lambda: not log.undelivered)
        assert artifacts(uri, runs_of(uri)["t1"]) == ["placement.png"]
        own.write(entry)  # once more changes nothing
    assert len(runs_of(uri)["t1"].inputs.dataset_inputs) == 2


def test_a_picture_that_is_gone_does_not_take_its_trial_with_it(uri, journal, picture, tmp_path):
    journal.parent.mkdir()
    gone = tmp_path / "gone.png"
    lines = Journal(journal)
    lines.append(
        TrialEntry(
            sweep="k1",
            key="t1",
            run_name="t1",
            time=1,
            params={},
            points=(),
            error=None,
            files=(str(gone), str(picture)),
        )
    )
    said = []
    with opened(uri, journal, say=said.append) as log:
        pass
    assert said == [f"MLflow: {gone} is gone, it is no longer logged"]
    assert not log.refused
    run = runs_of(uri)["t1"]
    assert run.info.status == "FINISHED"
    assert artifacts(uri, run) == ["placement.png"]


def samples(uri):
    run = runs_of(uri)["demo"]
    return [
        (point.step, point.value)
        for point in client(uri).get_metric_history(run.info.run_id, "system/cpu")
    ]


def test_samples_go_on_after_a_stop_and_come_once(uri, journal):
    with opened(uri, journal):
        until(lambda: "demo" in runs_of(uri))
        start = runs_of(uri)["demo"].info.start_time

    def sample(second):
        return SampleEntry(sweep="k1", time=start + 1000 * second, values={"system/cpu": second})

    for seconds in ((1, 11), (1, 11, 21), (600,)):  # the second driver finds a journal again
        lines = Journal(journal)
        for second in seconds:
            lines.append(sample(second))
        with opened(uri, journal):
            pass
    assert samples(uri) == [(1, 1), (11, 11), (21, 21), (600, 600)]


def test_the_view_of_the_page_is_the_experiments(uri, journal):
    columns = ["metrics.AP_R40_3D.Car.0.70", "params.scene.density"]
    with opened(uri, journal, columns=columns, ascending=True, about="What it is") as log:
        until(lambda: not log.undelivered)
        page = log.page()
    experiment = client(uri).get_experiment_by_name("demo")
    parent = runs_of(uri)["demo"].info.run_id
    begin = f"/#/experiments/{experiment.experiment_id}/runs?viewStateShareKey=lidarplace"
    assert page.startswith(begin)
    state = json.loads(experiment.tags[VIEW_TAG])
    assert state["selectedColumns"][1] == "params.`scene.density`"
    assert state["orderByKey"] == "metrics.`AP_R40_3D.Car.0.70`"
    assert state["runsExpanded"] == {parent: True}
    assert state["orderByAsc"] is True
    assert experiment.tags["mlflow.note.content"] == "What it is"


def models(uri):
    experiment = client(uri).get_experiment_by_name("demo").experiment_id
    return {m.tags["lidarplace.trial"]: m for m in client(uri).search_logged_models([experiment])}


def test_the_best_model_is_logged_once_and_the_mark_moves(uri, journal, picture, tmp_path):
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "MLmodel").write_text("flavors: {}")
    for key in ("t1", "t1", "t2"):
        with opened(uri, journal) as log:
            log_trial(log, picture, key)
            log.model(key, "second", folder, {"AP": 61.5})
        assert not log.refused
    found = models(uri)
    assert set(found) == {"t1", "t2"}
    assert [found[key].tags["lidarplace.best"] for key in ("t1", "t2")] == ["false", "true"]
    run = runs_of(uri)["t2"]
    assert found["t2"].source_run_id == run.info.run_id
    assert [output.model_id for output in run.outputs.model_outputs] == [found["t2"].model_id]
    assert {model.status.value for model in found.values()} == {"READY"}
    assert found["t2"].params == {"AP": "61.5"}


@pytest.mark.parametrize("fails_in", ["log_model_artifacts", "log_outputs"])
def test_a_model_cut_half_way_is_continued(uri, journal, picture, tmp_path, monkeypatch, fails_in):
    from mlflow import MlflowClient

    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "MLmodel").write_text("flavors: {}")
    whole, broken = getattr(MlflowClient, fails_in), []

    def breaks(self, *arguments):
        whole(self, *arguments)
        if not broken:
            broken.append(fails_in)
            raise ConnectionError("reset by peer")

    monkeypatch.setattr(MlflowClient, fails_in, breaks)
    with opened(uri, journal, say=str) as log:
        log_trial(log, picture)
        log.model("t1", "second", folder, {})
    assert broken
    assert not log.refused
    experiment = client(uri).get_experiment_by_name("demo").experiment_id
    (model,) = client(uri).search_logged_models([experiment])
    assert model.status.value == "READY"
    assert len(runs_of(uri)["t1"].outputs.model_outputs) == 1


def test_a_model_without_a_run_is_refused(uri, journal, tmp_path):
    said = []
    with opened(uri, journal, say=said.append) as log:
        log.model("t9", "second", tmp_path, {})
    assert log.refused == 1
    assert "trial t9 has no run" in said[0]
