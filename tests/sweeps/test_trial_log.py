"""What reaches MLflow: every trial with a result once, whoever finished it, and failures."""

from __future__ import annotations

import struct

import pandas as pd
import pytest
import yaml
from small_log import write_small_log

from sweeps.configuration.grid import read_sweep
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.mlflow.trials import TrialLog
from sweeps.plan.plan import make_plan
from sweeps.store.local import Store


class Log:
    """In the place of MLflow's."""

    def __init__(self, settled=()):
        self.settled = set(settled)
        self.trials = []

    def is_settled(self, key):
        return key in self.settled

    def trial(self, key, name, params, metrics, curve=None, error=None, **about):
        self.trials.append((name, metrics, error))
        self.about = about


class Quiet:
    def started(self, task): ...
    def finished(self, task): ...
    def failed(self, task, failure): ...


def finish(store, *tasks):
    surrogates = pd.DataFrame([("Car", "s_mig", -2.0)], columns=["class", "surrogate", "value"])
    columns = ["class", "metric", "iou", "difficulty", "value", "ground_truths"]
    metrics = pd.DataFrame([("Car", "AP_R40_3D", 0.7, "all", 50.0, 9)], columns=columns)
    curve = pd.DataFrame([(1, "loss", 0.5)], columns=["epoch", "metric", "value"])
    columns = ["class", "metric", "iou", "recall", "precision"]
    rows = [("Car", "AP_R40_3D", 0.7, recall, 100.0 - recall) for recall in (0.0, 50.0, 100.0)]
    value = {"table": surrogates, "metrics": metrics, "curve": curve}
    value["pr_curves"] = pd.DataFrame(rows, columns=columns)
    value |= {"weights": "scratch", "batch_size": 2, "classes": ["Car"]}
    for task in tasks:
        store.save(task, value, 1.0, peak_memory=3_000_000)


@pytest.fixture
def sweep(tmp_path):
    write_small_log(tmp_path / "log")
    path = tmp_path / "grid.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "scene": {"source": "log", "folder": str(tmp_path / "log")},
                "classes": ["Car"],
                "surrogate": {"accuracy": False, "sampling_error": False},
                "grid": {"placement": ["line", "center", "square"]},
            }
        )
    )
    plan = make_plan(read_sweep(path))
    store = Store(tmp_path / "store")

    pictures = tmp_path / "pictures"

    def listener(log):
        return TrialLog(Quiet(), log, plan, store, (), FailureFolder(tmp_path / "failed"), pictures)

    return plan, store, listener


METRICS = {
    "AP_R40_3D.Car.0.70": 50.0,
    "surrogate.s_mig.Car": -2.0,
    "seconds": 2.0,
    "peak_memory_megabytes": 3.0,
    "batch_size": 2,
}


def test_a_trial_is_logged_when_its_last_task_has_ended(sweep):
    plan, store, listener = sweep
    log = Log()
    own = listener(log)
    trial = plan.trials[0]
    for task in trial.results[:-1]:
        finish(store, task)
        own.finished(task)
        assert not log.trials
    finish(store, trial.results[-1])
    own.finished(trial.results[-1])
    assert log.trials == [(trial.label, METRICS, None)]


def test_a_run_can_be_filtered_and_tells_its_data_and_has_pictures(sweep):
    plan, store, listener = sweep
    finish(store, *(task for trial in plan.trials for task in trial.results))
    log = Log()
    listener(log)
    scene = plan.trials[-1].scenes[0]
    assert log.about["tags"] | {"folder": "log"} == {
        "placement": "square",
        "detector": "pointpillars_tiny",
        "seed": 0,
        "scene": "log",
        "folder": "log",
    }
    assert [(d.name, d.digest, d.context, d.profile) for d in log.about["datasets"]] == [
        ("log train", scene.key, "train", {"frames": 3}),
        ("log test", scene.key, "test", {"frames": 1}),
    ]
    assert [path.name for path in log.about["files"]] == ["placement.png", "precision_recall.png"]
    for path in log.about["files"]:
        width, height = struct.unpack(">II", path.read_bytes()[16:24])  # of a PNG
        assert width > 500
        assert height > 250


def test_what_was_there_is_logged_unless_mlflow_has_it(sweep):
    plan, store, listener = sweep
    for trial in plan.trials[:2]:
        finish(store, *trial.results)
    log = Log(settled=[plan.trials[0].key])
    listener(log)
    assert [name for name, *_ in log.trials] == [plan.trials[1].label]


def test_what_another_driver_finished_meanwhile_is_logged_too(sweep):
    plan, store, listener = sweep
    log = Log()
    own = listener(log)
    for trial in plan.trials[:2]:
        finish(store, *trial.results)
    own.log_rest({})
    assert [name for name, *_ in log.trials] == [trial.label for trial in plan.trials[:2]]


def test_failures_have_their_reason_and_the_surrogates_that_are_known(sweep):
    plan, store, listener = sweep
    log = Log()
    own = listener(log)
    finish(store, plan.trials[0].surrogates)
    own.log_rest({plan.trials[0].finetune.key: Failure("the loss is nan")})
    assert log.trials == [(plan.trials[0].label, {"surrogate.s_mig.Car": -2.0}, "the loss is nan")]
