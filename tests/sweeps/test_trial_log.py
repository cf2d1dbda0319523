"""Trials that reach MLflow: every trial with a result once, whoever finished it, and failures."""

import struct
from io import StringIO

import pandas as pd
import pytest

from lidarplace.command_line.terminal import Terminal
from sweeps.configuration.grid import read_sweep
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.mlflow.trials import TrialLog
from sweeps.plan.plan import make_plan
from sweeps.store.local import Store
from sweeps.store.result_folder import Ran
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import result


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
        store.save(task, result(**value), 1.0, Ran(peak_memory=3_000_000))


def planned(tmp_path, **keys):
    """A plan, its store, and a function that makes its log; `keys` of the configuration."""
    grid = {"placement": ["line", "center", "square"]}
    sweep = read_sweep(write_sweep(tmp_path, grid=grid, **keys))
    plan, store = make_plan(sweep), Store(tmp_path / "store")

    def listener():
        console, failures = Terminal(file=StringIO()), FailureFolder(tmp_path / "failed")
        cached, pictures = store.finished(plan.tasks), tmp_path / "pictures"
        return TrialLog(console, sweep, plan, store, failures, cached, pictures)

    return plan, store, listener


@pytest.fixture
def sweep(tmp_path):
    return planned(tmp_path)


METRICS = {"AP_R40_3D.Car.0.70": 50.0, "surrogate.s_mig.Car": -2.0, "seconds": 2.0}
METRICS |= {"peak_memory_megabytes": 3.0, "batch_size": 2}


def told(log):
    """Name, metrics and error of the trials that have ended."""
    ended = [(trial.describe(), trial.error) for trial in log.ended()]
    return [(run.name, run.metrics, error) for run, error in ended]


def test_a_trial_has_ended_when_its_last_task_has(sweep):
    plan, store, listener = sweep
    log = listener()
    trial = plan.trials[0]
    for task in trial.results[:-1]:
        finish(store, task)
        log.finished(task)
        assert not told(log)
    finish(store, trial.results[-1])
    log.finished(trial.results[-1])
    assert told(log) == [(trial.label, METRICS, None)]


def test_a_run_can_be_filtered_and_tells_its_data_and_has_pictures(sweep):
    plan, store, listener = sweep
    finish(store, *(task for trial in plan.trials for task in trial.results))
    *_, last = listener().ended()
    assert last.key == plan.trials[-1].key
    run = last.describe()
    scene = plan.trials[-1].scenes[0]
    of_rig = {"placement": "square", "detector": "pointpillars_tiny", "seed": 0}
    assert run.tags | {"folder": "log"} == of_rig | {"scene": "log", "folder": "log"}
    assert [(d.name, d.digest, d.context, d.profile) for d in run.datasets] == [
        ("log train", scene.key, "train", {"frames": 3}),
        ("log test", scene.key, "test", {"frames": 1}),
    ]
    assert [path.name for path in run.files] == ["placement.png", "precision_recall.png"]
    for path in run.files:
        width, height = struct.unpack(">II", path.read_bytes()[16:24])  # of a PNG
        assert width > 500
        assert height > 250


def test_what_was_there_has_ended_at_once_and_at_the_end_what_another_driver_finished(sweep):
    plan, store, listener = sweep
    log = listener()
    for trial in plan.trials[:2]:
        finish(store, *trial.results)
    labels = [trial.label for trial in plan.trials[:2]]
    assert [name for name, *_ in told(listener())] == labels
    assert not told(log)
    log.end({})
    assert [name for name, *_ in told(log)] == labels


def test_failures_have_their_reason_and_the_surrogates_that_are_known(sweep):
    plan, store, listener = sweep
    log = listener()
    finish(store, plan.trials[0].surrogates)
    log.end({plan.trials[0].finetune.key: Failure("the loss is nan")})
    assert told(log) == [(plan.trials[0].label, {"surrogate.s_mig.Car": -2.0}, "the loss is nan")]


def test_what_is_required_is_told_in_terms_of_what_is_needed(tmp_path):
    wanted = {"name": "near", "where": {"x": [3, 4], "y": [0, 1]}, "what": "Car", "step": 1.0}
    needs = [wanted | {"at_least": {"points": 10}}]
    plan, store, listener = planned(tmp_path, requirements=needs)
    trial = plan.trials[0]
    cases = [
        {"requirement": "near", "case": case, "value": value, "at_least": 10.0, "met": value >= 10}
        | {"undecided": 0.0}
        for case, value in (("as built", 25.0), ("without LiDAR 1", 4.0))
    ]
    finish(store, *(task for task in trial.results if task is not trial.requirements))
    assert not list(listener().ended()), "the trial has not all of its results"
    store.save(trial.requirements, result(table=pd.DataFrame(cases)), 1.0)
    (ended,) = listener().ended()
    metrics = ended.describe().metrics
    assert metrics["requirement.near"] == 0.4
    assert metrics["requirements_failed"] == 1
