import numpy as np
import pandas as pd
import pytest

from sweeps import execute as execute_module
from sweeps.execute import InProcess, execute
from sweeps.schedule import Schedule
from sweeps.store import Store
from sweeps.task import Task


class Recorder:
    def __init__(self):
        self.log = []

    def started(self, task):
        self.log.append(("started", task.label))

    def finished(self, task):
        self.log.append(("finished", task.label))

    def failed(self, task, reason, log):
        self.log.append(("failed", task.label, reason))


@pytest.fixture
def stages(monkeypatch):
    """Two small stages in place of the real ones: add the inputs, or fail."""
    calls = []

    def add(params, *inputs):
        calls.append(params["n"])
        return {"sum": params["n"] + sum(value["sum"] for value in inputs)}

    def fail(params, *inputs):
        raise ValueError("no such thing")

    monkeypatch.setitem(execute_module.FUNCTIONS, "scene", add)
    monkeypatch.setitem(execute_module.FUNCTIONS, "collect", add)
    monkeypatch.setitem(execute_module.FUNCTIONS, "finetune", fail)
    return calls


def diamond():
    scene = Task("scene", "a", {"n": 1})
    left = Task("collect", "b", {"n": 10}, (scene,))
    right = Task("collect", "c", {"n": 100}, (scene,))
    return [scene, left, right, Task("collect", "d", {"n": 1000}, (left, right))]


def run(tasks, folder):
    recorder = Recorder()
    store = Store(folder)
    return execute(tasks, store, InProcess(store), recorder), recorder, store


def test_results_flow_from_task_to_task(tmp_path, stages):
    tasks = diamond()
    failures, _, store = run(tasks, tmp_path)
    assert not failures
    assert store.load(tasks[-1])["sum"] == 1112


def test_what_is_in_the_store_is_not_computed_again(tmp_path, stages):
    tasks = diamond()
    run(tasks, tmp_path)
    stages.clear()
    more = [*diamond(), Task("collect", "e", {"n": 5}, (tasks[1],))]
    _, recorder, store = run(more, tmp_path)
    assert stages == [5]
    assert store.load(more[-1])["sum"] == 16
    assert recorder.log == [("started", "e"), ("finished", "e")]


def test_a_task_that_was_stopped_finds_what_it_had(tmp_path, monkeypatch):
    def twice(params, folder):
        if not folder.exists():
            folder.mkdir(parents=True)
            raise ValueError("stopped")
        return {"n": params["n"]}

    monkeypatch.setitem(execute_module.FUNCTIONS, "finetune", twice)
    task, other = (Task("finetune", "a", {"n": n}, resumable=True) for n in (1, 2))
    failures, _, store = run([task, other], tmp_path)
    assert len(failures) == 2, "each has its own folder"
    assert store.unfinished(task).is_dir()
    assert not store.has(task)
    failures, _, store = run([task], tmp_path)
    assert not failures
    assert store.load(task) == {"n": 1}
    assert not store.unfinished(task).exists()
    assert store.unfinished(other).exists()


def test_a_failure_takes_down_what_needs_it_and_nothing_else(tmp_path, stages):
    tasks = diamond()
    broken = Task("finetune", "broken", {}, (tasks[1],))
    needs = Task("collect", "needs", {"n": 1}, (broken,))
    failures, recorder, store = run([*tasks[:2], broken, needs, *tasks[2:]], tmp_path)
    assert failures == {
        broken.key: "no such thing",
        needs.key: "needs finetune 'broken', which failed",
    }
    assert store.has(tasks[-1])
    assert ("failed", "broken", "no such thing") in recorder.log
    assert ("started", "needs") not in recorder.log


def test_late_stages_come_first(tmp_path, stages):
    scene = Task("scene", "s", {"n": 0})
    other = Task("scene", "s2", {"n": 1})
    late = Task("collect", "late", {"n": 2}, (scene,))
    schedule = Schedule([scene, other, late], done={scene.key})
    assert schedule.next() is late


def test_store_round_trip(tmp_path):
    import torch

    store, task = Store(tmp_path), Task("scene", "a", {})
    value = {
        "table": pd.DataFrame({"a": [1, 2]}),
        "array": np.arange(6.0).reshape(2, 3),
        "state_dict": {"w": torch.ones(2)},
        "n": 3,
        "roi": {"x": [0, 1]},
    }
    assert not store.has(task)
    store.save(task, value, seconds=1.5)
    found = store.load(task)
    assert set(found) == set(value)
    pd.testing.assert_frame_equal(found["table"], value["table"])
    np.testing.assert_array_equal(found["array"], value["array"])
    assert torch.equal(found["state_dict"]["w"], value["state_dict"]["w"])
    assert (found["n"], found["roi"]) == (3, {"x": [0, 1]})
    assert store.seconds(task) == 1.5
    store.save(task, value | {"n": 4}, seconds=9.0)
    assert store.load(task)["n"] == 3, "what is there stays"
    assert [p.name for p in store.path(task).parent.iterdir()] == [task.key], "no leftovers"


def test_large_arrays_stay_on_disk(tmp_path):
    store, task = Store(tmp_path), Task("scene", "a", {})
    store.save(task, {"large": np.arange(200_000), "small": np.arange(5)}, seconds=0.0)
    found = store.load(task)
    assert isinstance(found["large"], np.memmap)
    assert not isinstance(found["small"], np.memmap)
    np.testing.assert_array_equal(found["large"], np.arange(200_000))


def test_a_result_that_cannot_be_written_leaves_nothing(tmp_path):
    store, task = Store(tmp_path), Task("scene", "a", {})
    with pytest.raises(TypeError):
        store.save(task, {"n": object()}, seconds=0.0)
    assert not store.has(task)
    assert not list(store.path(task).parent.iterdir())
