"""What a sweep is said to take is what it takes."""

import json

import pytest
import yaml
from small_log import write_small_log
from toy import Loud
from typer.testing import CliRunner

from sweeps.commands.run import app
from sweeps.configuration.grid import read_sweep
from sweeps.execution import estimate as module
from sweeps.execution.backends import InProcess, Later
from sweeps.execution.estimate import estimate
from sweeps.execution.execute import execute
from sweeps.plan.plan import make_plan
from sweeps.store.local import Store

pytestmark = pytest.mark.usefixtures("one_thread")

SWEEP = {
    "classes": ["Car"],
    "lidar": {"azimuth_steps": 360},
    "surrogate": {"resolution": 0.4, "accuracy": False, "sampling_error": False},
    "training": {"epochs": 3, "batch_size": 2},
    "grid": {"placement": ["center", "line"], "seed": [1, 2]},
    "ray": "debug",
}


@pytest.fixture
def config(tmp_path):
    write_small_log(tmp_path / "log")
    scene = {"source": "log", "folder": str(tmp_path / "log")}
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(SWEEP | {"scene": scene, "output": str(tmp_path / "runs")}))
    return path


def written(store, task):
    return sum(path.stat().st_size for path in store.path(task).iterdir())


def test_disk_and_stages_are_those_of_the_sweep(config, tmp_path):
    plan = make_plan(read_sweep(config, ["grid.placement=[center]"]))
    found = estimate(plan.trials, plan.tasks, set(), InProcess(), tmp_path / "not/there/yet")
    store = Store(tmp_path / "store")
    execute(plan.tasks, store, InProcess(), Loud())
    # The log is as short as what is tried, so that nothing but notes on the results differ.
    real = dict.fromkeys(found.stages, 0.0)
    for task in plan.tasks:
        real[task.stage] += written(store, task)
    assert {stage: own.bytes for stage, own in found.stages.items()} == pytest.approx(real, rel=0.1)
    assert found.bytes == pytest.approx(sum(real.values()), rel=0.1)
    assert found.free_bytes > 0
    assert 1e7 < found.task_memory < 1e11


def test_what_is_done_is_not_tried(config, tmp_path):
    plan = make_plan(read_sweep(config))
    done = {task.key for task in plan.tasks if task.stage in ("finetune", "evaluate")}
    tried = []

    class Listening(InProcess):
        def submit(self, function, *arguments, **about):
            tried.extend(task.stage for task in arguments[0])
            return super().submit(function, *arguments, **about)

    found = estimate(plan.trials, plan.tasks, done, Listening(), tmp_path)
    assert set(found.stages) == {"scene", "pog", "surrogates", "recall", "ground_truth", "collect"}
    assert set(tried) == set(found.stages)
    assert estimate(
        plan.trials, plan.tasks, {t.key for t in plan.tasks}, InProcess(), tmp_path
    ) == (module.Estimate({}, 0.0, 1, 0.0, 0.0, pytest.approx(found.free_bytes, rel=0.1)))


def test_seconds_follow_frames_and_epochs(config, tmp_path):
    """From made-up tries of 4 training and 2 test frames, for parts of 40 and 10."""
    plan = make_plan(read_sweep(config))
    few, seconds = {"train": 4.0, "test": 2.0}, {"finetune": 2.0, "collect": 0.5}

    class Canned(InProcess):
        cores = 2

        def submit(self, function, *arguments, **about):
            tried = {}
            for task in arguments[0]:
                own = seconds.get(task.stage, 1.0)
                size = module._size(task, few)
                tried.setdefault(module._kind(task), module._Tried(own, 10.0, 1e9, size))
            return Later(lambda: (tried, {"train": 40.0, "test": 10.0}, 7.0), ())

    found = estimate(plan.trials, plan.tasks, set(), Canned(), tmp_path)
    own = {stage: found.stages[stage].seconds for stage in found.stages}
    assert own == {
        "scene": 1.0,
        "pog": 1.0,
        "surrogates": 2.0,
        "recall": 2.0,
        "ground_truth": pytest.approx(50 / 6),
        "collect": pytest.approx(2 * 0.5 * (40 + 10) / 4),
        "finetune": pytest.approx(4 * 2.0 * (40 / 4) * 3),
        "evaluate": pytest.approx(4 * 1.0 * (10 / 2)),
    }
    assert found.seconds == pytest.approx(sum(own.values()) / 2 + 7.0)
    assert found.task_memory == 1e9


def test_the_command_tells_it(config):
    done = CliRunner().invoke(app, [str(config), "--dry-run", "--probe", "--json"])
    told = json.loads(done.stdout)["estimate"]
    assert told["stages"]["finetune"]["seconds"] > 0
    lines = CliRunner().invoke(app, [str(config), "--dry-run", "--probe"]).stdout
    assert "on disk" in lines
    assert "1 tasks at once" in lines
    assert CliRunner().invoke(app, [str(config), "--probe"]).exit_code == 2
