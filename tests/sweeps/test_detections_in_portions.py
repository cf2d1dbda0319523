"""A generalist's detections are those of kept clouds, and of all frames at once."""

import pandas as pd
import pytest
import yaml

from lidarplace.scenes.recorded import LogScene, log_parts
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import make_plan
from sweeps.search.trials.by_generalist import detect_task, metrics_of_portions
from sweeps.store.local import Store
from tests.sweeps.small_log import write_small_log
from tests.sweeps.toy import result
from training import build_detector

SETTINGS = {"placement": "line", "evaluator": "generalist", "classes": ["Car"]}
SETTINGS |= {"generalist": {"rigs": 3, "rigs_per_frame": 1, "epochs": 1}}
SETTINGS |= {"detector": "pointpillars_tiny", "training": {"score_threshold": 0.0}}
SETTINGS |= {"lidar": {"beams": 8, "azimuth_steps": 180}, "surrogate": {"resolution": 0.8}}
SETTINGS |= {"mounting_errors": {"offset": 0.01, "angle_deg": 0.5}}


def trial_of(folder, **changes):
    path = folder / "grid.yaml"
    path.write_text(yaml.safe_dump(SETTINGS | changes))
    (trial,) = make_plan(read_sweep(path)).trials
    return trial


def value_of(task, values):
    """The result of a task and, before it, of all that it needs."""
    if task.key not in values:
        inputs = [value_of(needed, values) for needed in task.inputs]
        values[task.key] = task.stage.run(*inputs)
    return values[task.key]


@pytest.fixture
def judged(tmp_path):
    """A trial, and a store in which its generalist is some network."""
    write_small_log(tmp_path / "log")
    log = pd.read_parquet(tmp_path / "log/frames.parquet")
    log["split"] = ["train", "test", "test", "test"]
    log.to_parquet(tmp_path / "log/frames.parquet")
    trial = trial_of(tmp_path, scene={"source": "log", "folder": str(tmp_path / "log")})
    points = trial.evaluate.stage.point_range
    model = build_detector("pointpillars_tiny", ["Car"], point_range=points)
    weights = result(state_dict=model.state_dict(), classes=["Car"])
    return trial, {trial.finetune.key: weights}, Store(tmp_path / "store")


def test_detections_are_those_of_kept_clouds(judged):
    trial, values, _ = judged
    whole = value_of(trial.evaluate, values).detections
    parts = [value_of(detect_task(trial.evaluate, i, 2), values) for i in range(2)]
    assert [part.frames["frame"].tolist() for part in parts] == [[1, 3], [2]]
    detections = pd.concat([part.detections for part in parts]).sort_values("frame", kind="stable")
    assert len(detections) > 0
    pd.testing.assert_frame_equal(detections.reset_index(drop=True), whole)


def test_metrics_of_all_portions_are_those_of_the_whole(judged):
    trial, values, store = judged
    every = [detect_task(trial.evaluate, i, n) for n in (1, 3) for i in range(n)]
    truth = next(task for task in trial.evaluate.inputs if task.stage.name == "ground_truth")
    for task in [*every, truth]:
        store.save(task, value_of(task, values), 0.0)
    tables = [
        metrics_of_portions(store, p, [truth], ["Car"], {}, ()) for p in (every[:1], every[1:])
    ]
    pd.testing.assert_frame_equal(*tables)


def test_a_log_s_tests_can_be_those_of_another_log(tmp_path):
    for name in ("own", "other"):
        write_small_log(tmp_path / name)
    first, other = (LogScene(source="log", folder=tmp_path / name) for name in ("own", "other"))
    both = LogScene(source="log", folder=tmp_path / "own", test_folder=tmp_path / "other")
    assert both.frame_counts() == (3, 1)
    train, test = log_parts(both)
    assert (train.splits, test.splits) == (("train",), ("test",))
    assert train.recording == log_parts(first)[0].recording  # trainings stay as they are
    assert test.recording == log_parts(other)[0].recording
    with pytest.raises(ValueError, match="test_folder: "):
        LogScene(source="log", folder=first.folder, test_folder=other.folder, clouds="recorded")
