"""A base checkpoint of mixed placements, through the plan and the store of a sweep."""

import hashlib

import numpy as np
import pytest
import torch

from sweeps.commands.pretrain import app
from sweeps.configuration.grid import read_sweep
from sweeps.execution.backends import InProcess
from sweeps.execution.execute import execute
from sweeps.plan.plan import make_plan
from sweeps.plan.pretrain_task import pretrain_task, training_of
from sweeps.stages.task import with_inputs
from sweeps.store.local import Store
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import Loud, call
from training import build_detector

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = {
    "classes": ["Car", "Cyclist", "Pedestrian"],
    "training": {"epochs": 2, "batch_size": 2},
    "grid": {"placement": ["line", "center"], "seed": [1, 2], "lidar.range_noise": [0.0, 0.02]},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pretrain")


def write(folder, **changes):
    return write_sweep(folder, **TINY | changes)


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def planned(path):
    sweep = read_sweep(path)
    plan = make_plan(sweep)
    return pretrain_task([training_of(sweep, plan)]), plan


def test_the_clouds_of_all_placements_train_together(folder):
    task, plan = planned(write(folder))
    clouds = [needed for needed in task.inputs if needed.stage.name == "collect"]
    assert len(clouds) == 4, "two placements with two LiDARs; the seeds share them"
    assert {cloud.stage.split for cloud in clouds} == {"train"}
    truths = [needed for needed in task.inputs if needed.stage.name == "ground_truth"]
    assert len(truths) == 1, "or every object would be there twice"
    assert len(task.inputs) == 5
    assert task.stage.seed == 1
    keys = {item.key for item in plan.tasks}
    seen = set()
    for needed in with_inputs([task]):
        assert all(item.key in seen for item in needed.inputs)
        assert needed.key not in seen
        assert needed.key in keys or needed is task
        seen.add(needed.key)
    stages = {item.stage.name for item in with_inputs([task])}
    assert stages == {"scene", "ground_truth", "collect", "pretrain"}


def test_the_range_holds_that_of_every_placement(folder):
    quirk = {"placement": ["line", "pyramid"], "lidar.misaligned_heights": [True]}
    task, plan = planned(write(folder, grid=quirk))
    ranges = np.array([trial.finetune.stage.point_range for trial in plan.trials])
    assert len(np.unique(ranges, axis=0)) == 2
    expected = [*ranges[:, :3].min(axis=0), *ranges[:, 3:].max(axis=0)]
    assert list(task.stage.point_range) == expected


def test_the_command_writes_weights_to_start_from(folder):
    config, out = write(folder), folder / "weights" / "base.pt"
    result = call(app, config, "--out", out)
    description = "pointpillars_tiny · 4 rigs, classes Car, Cyclist, Pedestrian, from scratch"
    assert description in result.output
    content = torch.load(out, weights_only=True)
    assert content["detector"] == "pointpillars_tiny"
    assert content["classes"] == ["Car", "Cyclist", "Pedestrian"], "all, also those without object"
    assert content["model_state"]["global_step"] == 2 * 6, "three frames of four clouds, twice"
    build_detector("pointpillars_tiny", content["classes"]).load_state_dict(content["model_state"])
    unfinished = list((folder / "runs" / "store" / "pretrain").glob(".*"))
    assert not unfinished
    call(app, config, "--out", folder / "again.pt")
    other = torch.load(folder / "again.pt", weights_only=True)["model_state"]
    assert all(torch.equal(value, other[key]) for key, value in content["model_state"].items())
    # A trial from scratch has heads for what occurs, one from the base those of the base.
    store = Store(folder / "runs" / "store")
    for override, weights, classes in (
        ("training.checkpoint=null", "scratch", ["Car"]),
        (f"training.checkpoint={out}", f"base.pt sha256:{digest(out)}", content["classes"]),
    ):
        trial = make_plan(read_sweep(config, [override])).trials[0]
        execute(with_inputs([trial.evaluate]), store, InProcess(), Loud())
        training = store.load(trial.finetune)
        assert (training.weights, training.classes) == (weights, classes)
        reported = store.load(trial.evaluate).metrics["class"]
        assert set(content["classes"]) <= set(reported), "all that the configuration names"


def test_a_file_that_cannot_be_written_is_told_before_anything_is_trained(folder):
    (line,) = call(app, write(folder), "--out", "/proc/none.pt", code=2).stderr.splitlines()
    assert "/proc" in line


def test_a_base_does_not_start_from_itself(folder):
    out = folder / "own.pt"
    small = {"training": {"epochs": 1, "batch_size": 2, "checkpoint": str(out)}}
    config = write(folder, grid={"placement": ["line"]}, **small)
    digests = set()
    for _ in range(2):
        assert "from scratch" in call(app, config, "--out", out).output
        digests.add(digest(out))
    assert len(digests) == 1


def test_a_training_that_fails_says_why(folder):
    training = {"epochs": 3, "lr": 1e6, "div_factor": 1, "grad_norm_clip": 1e6}
    config = write(folder, training=training)
    result = call(app, config, "--out", folder / "none.pt", code=1)
    assert "failed: pointpillars_tiny · 4 rigs: ArithmeticError: the " in result.output
    (log,) = (folder / "runs" / "grid" / "failed").glob("pretrain-*.log")
    assert "Traceback" in log.read_text()
    assert not (folder / "none.pt").exists()
