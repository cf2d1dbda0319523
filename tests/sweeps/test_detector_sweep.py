"""All networks, as small as they come, through the plan and the store of one sweep."""

import numpy as np
import pytest

from sweeps.configuration.grid import read_sweep
from sweeps.execution.backends import InProcess
from sweeps.execution.execute import execute
from sweeps.plan.plan import make_plan
from sweeps.store.local import Store
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import Loud
from training import NETWORKS

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize(
    "networks",
    [("pointpillars", "pv_rcnn"), pytest.param(tuple(NETWORKS), marks=pytest.mark.long)],
    ids=["one of one stage, one of two", "all"],
)
def test_every_network_trains_and_is_evaluated(tmp_path, networks):
    grid = {"placement": ["center"], "detector": [f"{name}_tiny" for name in networks]}
    plan = make_plan(read_sweep(write_sweep(tmp_path, classes=["Car", "Pedestrian"], grid=grid)))
    store = Store(tmp_path / "store")
    execute(plan.tasks, store, InProcess(), Loud())
    assert [trial.finetune.stage.detector for trial in plan.trials] == grid["detector"]
    for trial in plan.trials:
        training = store.load(trial.finetune)
        assert training.classes == ["Car"], "no pedestrian occurs"
        loss = training.curve.set_index("metric")["value"]["loss"]
        assert np.isfinite(loss)
        metrics = store.load(trial.evaluate).metrics
        value = metrics.set_index(["metric", "iou", "class"])["value"]
        assert 0 <= value["recall", 0.5, "all"] <= 100
        assert 0 <= value["AP_R40_3D", 0.7, "Car"] <= 100
        assert np.isnan(value["AP_R40_3D", 0.5, "Pedestrian"])
