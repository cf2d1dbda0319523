"""The best weights as an MLflow model: loaded by a fresh process, it finds the same boxes."""

import subprocess
import sys
from functools import partial

import numpy as np
import pandas as pd
import pytest
import yaml
from small_log import write_small_log

from lidarplace.clouds.clouds import PointClouds
from sweeps.configuration.grid import read_sweep
from sweeps.mlflow.best_models import log_best_models
from sweeps.plan.plan import make_plan
from sweeps.store.local import Store
from tests.sweeps.toy import result
from tracking.mlflow.content import EndedTrial, ParentRun, TrialRun
from tracking.mlflow.log import SweepLog

PREDICT = """
import sys
import mlflow, pandas
uri, model, points, boxes, boxes_of_doubles = sys.argv[1:]
mlflow.set_tracking_uri(uri)
loaded = mlflow.pyfunc.load_model(model)
points = pandas.read_parquet(points)
loaded.predict(points).to_parquet(boxes)
doubles = points.astype(dict.fromkeys(["x", "y", "z", "intensity"], "float64"))
loaded.predict(doubles).to_parquet(boxes_of_doubles)
print(loaded.metadata.signature.outputs.input_names())
for column, value in (("z", float("nan")), ("intensity", 255.0)):
    bad = doubles.reset_index(drop=True)
    bad.loc[5:6, column] = value
    try:
        loaded.predict(bad)
    except ValueError as error:
        print(error)
"""

CROP = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)


@pytest.fixture
def sweep(tmp_path):
    """Two trials with results: the second is better."""
    from training import build_detector

    write_small_log(tmp_path / "log")
    path = tmp_path / "grid.yaml"
    config = {
        "scene": {"source": "log", "folder": str(tmp_path / "log")},
        "classes": ["Car"],
        "surrogate": {"accuracy": False, "sampling_error": False},
        "training": {"score_threshold": 0.0},  # so that an untrained network finds something
        "grid": {"placement": ["line", "center"]},
    }
    path.write_text(yaml.safe_dump(config))
    plan = make_plan(read_sweep(path))
    store = Store(tmp_path / "store")
    columns = ["class", "metric", "iou", "difficulty", "value", "ground_truths"]
    for trial, ap in zip(plan.trials, (50.0, 60.0), strict=True):
        network = build_detector("pointpillars_tiny", ["Car"], point_range=CROP)
        value = result(state_dict=network.state_dict(), classes=["Car"])
        store.save(trial.finetune, value, 1.0)
        metrics = pd.DataFrame([("Car", "AP_R40_3D", 0.7, "all", ap, 9)], columns=columns)
        store.save(trial.evaluate, result(metrics=metrics), 1.0)
    return plan, store


def test_a_fresh_process_loads_the_best_and_finds_the_same_boxes(sweep, tmp_path):
    from mlflow import MlflowClient

    from training.detect import detect

    plan, store = sweep
    uri, folder = f"sqlite:///{tmp_path}/mlflow.db", tmp_path / "models"
    for _ in range(2):
        with SweepLog(uri, ParentRun("k1", "demo", {}), folder=tmp_path) as log:
            log.follow(
                lambda: [
                    EndedTrial(trial.key, partial(TrialRun, trial.label, {}, {}, ended=1))
                    for trial in plan.trials
                ]
            )
            log_best_models(plan.trials, store, folder, log)
        assert not log.refused
    client = MlflowClient(tracking_uri=uri)
    experiment = client.get_experiment_by_name("demo").experiment_id
    (model,) = client.search_logged_models([experiment])
    best = plan.trials[1]
    assert model.tags["lidarplace.trial"] == best.key
    assert model.params == {"placement": "center", "seed": "0", "AP_R40_3D.Car": "60.00"}

    random = np.random.default_rng(1)
    low, high = np.array(CROP).reshape(2, 3)
    frames = [
        np.c_[random.uniform(low, high, (900, 3)), random.random(900)].astype(np.float32)
        for _ in range(2)
    ]
    clouds = PointClouds.from_frames([7, 3], ((points, [900]) for points in frames), CROP)
    columns = ["x", "y", "z", "intensity"]
    points = pd.concat(
        [
            pd.DataFrame(clouds[i], columns=columns).assign(frame=number)
            for i, number in enumerate((7, 3))
        ]
    )
    points.to_parquet(tmp_path / "points.parquet")
    tables = [tmp_path / f"{name}.parquet" for name in ("points", "boxes", "boxes_of_doubles")]
    arguments = [uri, model.model_uri, *tables]
    done = subprocess.run(
        [sys.executable, "-c", PREDICT, *map(str, arguments)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    _, found, of_doubles = map(pd.read_parquet, tables)
    pd.testing.assert_frame_equal(found, of_doubles)

    params = best.evaluate.params
    weights = store.read(best.finetune, lambda own: own.state_dict)
    settings = params.training
    wanted = detect(
        "pointpillars_tiny", ["Car"], weights, clouds, settings, params.point_range
    ).boxes
    assert len(wanted) > 1
    assert list(found.columns) == list(wanted.columns)
    names, no_place, bright = done.stdout.splitlines()
    assert names == str(list(wanted.columns))
    for refused in (no_place, bright):
        assert refused.startswith("row 5: a point must be finite, with an intensity in [0, 1]; ")
    assert no_place.endswith(" and 1 more")
    assert ", 255.0] and 1 more" in bright
    for number in (3, 7):
        pd.testing.assert_frame_equal(
            found[found["frame"] == number].reset_index(drop=True),
            wanted[wanted["frame"] == number].reset_index(drop=True),
            check_dtype=False,
            rtol=1e-5,
            atol=1e-5,
        )
    assert not list(folder.rglob("*.pkl"))


def test_a_better_trial_is_made_a_model_beside_the_earlier(sweep, tmp_path):
    plan, store = sweep
    said = []

    class Log:
        def model(self, model):
            said.append(model.trial)

    for trials in (plan.trials[:1], plan.trials, plan.trials):
        log_best_models(trials, store, tmp_path, Log())
    first, second = (trial.key for trial in plan.trials)
    assert said == [first, second, second]
    assert {path.parent.name for path in tmp_path.glob("pointpillars_tiny/*/MLmodel")} == {
        first,
        second,
    }
