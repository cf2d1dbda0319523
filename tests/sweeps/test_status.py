"""Where a sweep stands, told from what lies on the disk."""

import json
from pathlib import Path

import pytest

from sweeps.commands.status import app
from sweeps.configuration.grid import read_sweep
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.schedule import Schedule
from sweeps.plan.plan import make_plan
from sweeps.results.state import sweep_state
from sweeps.store.local import Note, Store
from sweeps.store.lock import locked
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import Toy, call


@pytest.fixture
def sweep(tmp_path):
    path = write_sweep(tmp_path, grid={"placement": ["line", "center"], "seed": [1, 2]})
    read = read_sweep(path)
    return path, read, make_plan(read), Store(tmp_path / "runs/store")


def finish(store, *tasks):
    for task in tasks:
        store.save(task, Toy(1), 1.0)


def test_nothing_has_begun(sweep):
    _, read, plan, store = sweep
    state = sweep_state(read, plan, store)
    assert not state.alive
    assert {trial.status for trial in state.trials} == {"waiting"}
    assert state.stages["finetune"] == {"waiting": 4}
    assert not read.common.output.exists(), "a look leaves no trace"


def test_every_status(sweep):
    path, read, plan, store = sweep
    finished, running, failed, _waiting = plan.trials
    finish(store, *plan.needed_for(finished.results))
    finish(store, *running.finetune.inputs, *failed.finetune.inputs)
    folder = read.common.output / "grid"
    failures = FailureFolder(folder / "failed")
    failures.write(finished.evaluate, Failure("once"))  # which the result outweighs
    failures.write(failed.finetune, Failure("the loss is nan", "Traceback …", lasting=True))
    why = f"needs finetune '{failed.label}', which failed"
    failures.write(failed.evaluate, Failure(why, lasting=True, follows=True))
    note = Note("node7", 42, "2026-01-02 03:04:05")
    with locked(folder, alone=True), store.running(running.finetune, note):
        state = sweep_state(read, plan, store)
        assert state.alive
        result = call(app, path)
        as_json = json.loads(call(app, path, "--json").output)
    assert [trial.status for trial in state.trials] == ["done", "running", "failed", "waiting"]
    assert state.trials[1].detail == "finetune on node7, process 42, since 2026-01-02 03:04:05"
    assert state.trials[2].detail == "the loss is nan"
    assert "Traceback …" in Path(state.trials[2].log).read_text()
    assert state.stages["finetune"] == {"done": 1, "running": 1, "failed": 1, "waiting": 1}
    assert state.stages["evaluate"] == {"done": 1, "waiting": 2, "failed": 1}
    for text in ("grid: running; 4 trials: 1 done, 1 running", "node7", "the loss is nan"):
        assert text in result.output
    assert as_json["trials"][1]["status"] == "running"


def test_what_ran_when_the_driver_was_killed(sweep):
    _, read, plan, store = sweep
    trial = plan.trials[0]
    (read.common.output / "grid").mkdir(parents=True)
    with store.running(trial.scenes[0], Note("a", 1, "then")):
        state = sweep_state(read, plan, store)
    assert not state.alive
    assert {t.status for t in state.trials} == {"stopped"}
    assert state.stages["scene"] == {"stopped": 1}


def test_the_reason_is_that_of_the_first_task_that_failed(sweep):
    _, read, plan, store = sweep
    scene = plan.trials[0].scenes[0]
    failures = FailureFolder(read.common.output / "grid/failed")
    schedule = Schedule(plan.tasks, set())
    for task in schedule.fail(scene, Failure("no such town", "Traceback …", lasting=True)):
        failures.write(task, schedule.failed[task.key])
    state = sweep_state(read, plan, store)
    assert {t.status for t in state.trials} == {"failed"}
    assert {t.detail for t in state.trials} == {f"scene '{scene.label}' failed: no such town"}
    assert all("Traceback …" in Path(t.log).read_text() for t in state.trials)
    finish(store, scene)  # by another sweep that shares the store
    assert failures.lasting(rerun=False, finished={scene.key}) == {}
    assert {t.status for t in sweep_state(read, plan, store).trials} == {"waiting"}


def test_many_trials_are_summed_up(sweep, monkeypatch):
    path, _, plan, store = sweep
    monkeypatch.setattr("sweeps.commands.status._MOST_TRIALS", 3)
    finish(store, *plan.needed_for(plan.trials[0].results))
    short = call(app, path).output
    assert "4 more trials: --all lists them" in short
    assert plan.trials[0].label not in short
    assert plan.trials[0].label in call(app, path, "--all").output


@pytest.mark.parametrize("text", ["", "{", "7", "[]", '{"log": 1}', "[" * 100_000])
def test_what_is_no_failure_is_named(tmp_path, text):
    (tmp_path / "0123.json").write_text(text)
    with pytest.raises(ValueError, match=r"0123\.json: .*remove it to retry its task$"):
        FailureFolder(tmp_path).read()
