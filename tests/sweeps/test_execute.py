import shutil

import pytest

from sweeps.execution.backends import InProcess, Room
from sweeps.execution.execute import Outcome, execute
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.schedule import Schedule
from sweeps.execution.worker import _load
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage
from sweeps.store.local import Store
from sweeps.store.result_folder import DamagedResult
from tests.sweeps.toy import CollectToy, Loud, SceneToy, Toy, TrainingToy, flip_bit
from training.settings import TrainingSettings


class Recorder:
    def __init__(self):
        self.log = []

    def started(self, task):
        self.log.append(("started", task.label))

    def finished(self, task):
        self.log.append(("finished", task.label))

    def failed(self, task, failure):
        self.log.append(("failed", task.label, failure.reason))


@pytest.fixture
def stages(monkeypatch):
    """Two small stages: one adds its inputs, one fails. Returns what the first was called with."""
    calls, add = [], SceneToy.run

    def noted(stage, *inputs) -> Toy:
        calls.append(stage.n)
        return add(stage, *inputs)

    def fail(stage, *inputs, **how):
        raise ValueError("no such thing")

    monkeypatch.setattr(SceneToy, "run", noted)
    monkeypatch.setattr(TrainingToy, "run", fail)
    monkeypatch.setattr(FinetuneStage, "run", fail)
    return calls


def diamond():
    scene = Task(SceneToy(1), "a")
    left = Task(CollectToy(10), "b", (scene,))
    right = Task(CollectToy(100), "c", (scene,))
    return [scene, left, right, Task(CollectToy(1000), "d", (left, right))]


def run(tasks, folder, known=None, backend=InProcess):
    recorder = Recorder()
    store = Store(folder)
    outcome = execute(tasks, store, backend(), recorder, lasting_failures=known)
    return outcome.failures, recorder, store


def reasons(failures):
    return {key: failure.reason for key, failure in failures.items()}


def test_results_flow_from_task_to_task_and_are_not_computed_again(tmp_path, stages):
    tasks = diamond()
    failures, _, store = run(tasks, tmp_path)
    assert not failures
    assert store.load(tasks[-1]).n == 1112
    stages.clear()
    more = [*diamond(), Task(CollectToy(5), "e", (tasks[1],))]
    _, recorder, store = run(more, tmp_path)
    assert stages == [5]
    assert store.load(more[-1]).n == 16
    assert recorder.log == [("started", "e"), ("finished", "e")]


def test_times_are_kept_of_what_ran_though_a_clock_jumps(tmp_path, stages, monkeypatch):
    hours = iter(range(10**6, 0, -1))
    for name in ("time", "time_ns"):
        monkeypatch.setattr(f"time.{name}", lambda: 3600 * next(hours))
    tasks = diamond()
    store = Store(tmp_path)
    outcome = execute(tasks, store, InProcess(), Loud())
    assert set(outcome.times) == {task.key for task in tasks}
    ends = [outcome.times[task.key][1] for task in tasks]
    assert outcome.times[tasks[-1].key][0] >= max(ends[:-1])
    assert all(0 <= end - start < 3600 for start, end in outcome.times.values())
    assert all(0 <= store.record(task).seconds < 3600 for task in tasks)


def test_a_task_that_was_stopped_finds_what_it_had(tmp_path, monkeypatch):
    def twice(stage, folder, **how) -> Toy:
        if not list(folder.iterdir()):
            (folder / "last.pt").write_text("half way")
            raise ValueError("stopped")
        return Toy([stage.seed, (folder / "last.pt").read_text()])

    monkeypatch.setattr(FinetuneStage, "run", twice)
    task, other = (training(n) for n in (1, 2))
    failures, _, store = run([task, other], tmp_path)
    assert len(failures) == 2, "each has its own folder"
    assert not store.has(task)
    failures, _, store = run([task], tmp_path)
    assert not failures
    assert store.load(task) == Toy([1, "half way"])
    assert [entry.key for entry in store.contents() if entry.kind == "working"] == [other.key]


def test_a_failure_takes_down_what_needs_it_and_nothing_else(tmp_path, stages):
    tasks = diamond()
    broken = Task(TrainingToy(), "broken", (tasks[1],))
    needs = Task(CollectToy(1), "needs", (broken,))
    failures, recorder, store = run([*tasks[:2], broken, needs, *tasks[2:]], tmp_path)
    told = "finetune 'broken' failed: no such thing"
    assert reasons(failures) == {broken.key: "no such thing", needs.key: told}
    assert [failures[task.key].follows for task in (broken, needs)] == [False, True]
    assert store.has(tasks[-1])
    assert ("failed", "broken", "no such thing") in recorder.log
    assert ("started", "needs") not in recorder.log


def test_what_failed_for_good_is_not_tried_again(tmp_path, stages):
    tasks = diamond()
    known = {tasks[1].key: Failure("the data are wrong", lasting=True)}
    failures, recorder, store = run(tasks, tmp_path, known)
    told = "collect 'b' failed: the data are wrong"
    assert reasons(failures) == {tasks[1].key: "the data are wrong", tasks[3].key: told}
    assert ("started", "b") not in recorder.log
    assert store.has(tasks[2])
    failures, _, store = run(tasks, tmp_path)
    assert not failures
    failures, recorder, _ = run(tasks, tmp_path, known)
    assert not failures, "what is there is no failure"
    assert not recorder.log


def test_a_damaged_input_ends_all_and_the_next_time_it_is_computed_again(tmp_path, stages):
    tasks = diamond()
    _, _, store = run(tasks[:2], tmp_path)
    flip_bit(store.path(tasks[1]) / "result.json", 0.5)
    _load.cache_clear()
    recorder = Recorder()
    with pytest.raises(DamagedResult, match=f"{tasks[1].key} is damaged"):
        execute(tasks, store, InProcess(), recorder)
    assert not [entry for entry in recorder.log if entry[0] == "failed"]
    failures, recorder, store = run(tasks, tmp_path)
    assert not failures
    assert store.load(tasks[-1]).n == 1112
    assert ("started", "b") in recorder.log
    assert ("started", "a") not in recorder.log


def test_an_input_that_another_worker_found_damaged_is_no_failure(tmp_path, stages, monkeypatch):
    """Two workers meet it; the second finds nothing where it was."""
    tasks = diamond()
    _, _, store = run(tasks[:1], tmp_path)

    def gone(stage, *inputs):
        shutil.rmtree(store.path(tasks[0]))
        raise FileNotFoundError("no such result")

    monkeypatch.setattr(CollectToy, "run", gone)
    with pytest.raises(DamagedResult, match="no such result"):
        execute(tasks, store, InProcess(), Recorder())


@pytest.mark.parametrize(
    ("error", "lasting"),
    [
        (ValueError("a bad box"), True),
        (ArithmeticError("the loss is nan"), True),
        (OSError(28, "No space left on device"), False),
        (MemoryError(), False),
        (RuntimeError("CUDA error: unspecified launch failure"), False),
    ],
)
def test_only_data_and_settings_fail_for_good(tmp_path, monkeypatch, error, lasting):
    def fail(stage):
        raise error

    monkeypatch.setattr(SceneToy, "run", fail)
    task = Task(SceneToy(), "a")
    failures, _, _ = run([task], tmp_path / "store")
    folder = FailureFolder(tmp_path / "failed")
    folder.write(task, failures[task.key])
    assert folder.read() == failures
    assert failures[task.key].lasting is lasting
    assert str(error).split(";")[0] in folder.log(task).read_text()
    folder.forget(task.key)
    assert not folder.read()
    assert not folder.log(task).exists()


def test_which_failures_the_next_run_knows(tmp_path):
    folder = FailureFolder(tmp_path / "failed")
    kinds = {"a": Failure("bad data", lasting=True), "b": Failure("the worker died")}
    kinds["d"] = Failure("bad data", lasting=True, follows=True)
    tasks = {name: Task(SceneToy(name), name) for name in "abcd"}

    def fill():
        for name, task in tasks.items():
            folder.write(task, kinds.get(name, kinds["a"]))

    fill()
    assert folder.lasting(rerun=False, finished={tasks["c"].key}) == {tasks["a"].key: kinds["a"]}
    assert set(folder.read()) == {tasks["a"].key}, "the others are tried again, or there"
    fill()
    assert folder.lasting(rerun=True, finished=set()) == {}
    assert not list(folder.folder.iterdir())


def test_another_driver_may_finish_a_task_first(tmp_path, monkeypatch):
    """It tidies up under this one, whose attempt then fails: no harm is done."""
    task = Task(SceneToy(), "a")

    def overtaken(stage) -> Toy:
        Store(tmp_path).save(task, Toy(1), 0.0)
        raise FileNotFoundError("last.pt")

    monkeypatch.setattr(SceneToy, "run", overtaken)
    failures, _, store = run([task], tmp_path)
    assert not failures
    assert store.load(task) == Toy(1)


def test_what_another_driver_did_since_the_start_is_not_done_again(tmp_path, monkeypatch):
    first, second = Task(SceneToy(1), "a"), Task(SceneToy(2), "b")

    def with_the_other(stage) -> Toy:
        Store(tmp_path).save(second, Toy("theirs"), 0.0)
        return Toy("ours")

    monkeypatch.setattr(SceneToy, "run", with_the_other)
    failures, recorder, store = run([first, second], tmp_path)
    assert not failures
    assert store.load(second) == Toy("theirs")
    assert ("started", "b") not in recorder.log
    assert ("finished", "b") in recorder.log


class Remembering(InProcess):
    """A backend on which four trainings share a GPU, and that remembers what is needed."""

    gpus_per_training = 0.25
    needs: dict

    def __init__(self):
        self.needs = {}

    def submit(self, function, task, *arguments, name, need):
        self.needs.setdefault(task.key, []).append(need)
        return super().submit(function, task, *arguments, name=name, need=need)


def training(n, batch_size=8):
    settings, crop = TrainingSettings(batch_size=batch_size), (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    stage = FinetuneStage("second", ("Car",), settings, crop, seed=n, checkpoint=None)
    return Task(stage, f"second {n}")


def train_at_once(stage, *inputs, **how) -> Toy:
    return Toy(1)


class OutOfMemoryError(RuntimeError):
    """Of the same name as torch's."""


def test_a_gpu_that_is_too_small_for_one_frame_is_not_tried_for_ever(tmp_path, monkeypatch):
    tried = []

    def fail(stage, *inputs, **how):
        tried.append(how)
        raise OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(FinetuneStage, "run", fail)
    failures, _, _ = run([training(1, batch_size="auto")], tmp_path)
    assert len(failures) == 1
    assert [how["halvings"] for how in tried] == [0, 1, 2, 3, 4]


def test_what_failed_in_a_rung_may_succeed_later(tmp_path, monkeypatch):
    """And what failed for good there is not tried again."""
    asked = []

    def flaky(stage):
        asked.append(stage.n)
        if stage.n == "bad":
            raise ValueError("the data are wrong")
        if asked.count(stage.n) == 1:
            raise OSError(28, "No space left on device")
        return Toy(1)

    monkeypatch.setattr(SceneToy, "run", flaky)
    tasks = [Task(SceneToy(name), name) for name in ("bad", "unlucky")]
    store, outcome = Store(tmp_path), Outcome()
    for _ in range(2):
        execute(tasks, store, InProcess(), Recorder(), outcome)
    assert set(outcome.failures) == {tasks[0].key}
    assert asked == ["bad", "unlucky", "unlucky"]


def test_a_training_that_is_too_large_for_a_gpu_is_tried_alone_with_half_the_batch(
    tmp_path, monkeypatch
):
    tried = []

    def train(stage, *inputs, halvings, **how) -> Toy:
        size = stage.training.batch_size >> halvings
        tried.append((stage.seed, size))
        if size > stage.seed:
            raise OutOfMemoryError("CUDA out of memory")
        return Toy(size)

    monkeypatch.setattr(FinetuneStage, "run", train)
    fits, fits_not = training(2), training(0)
    store, recorder = Store(tmp_path), Recorder()
    backend = Remembering()
    outcome = execute([fits, fits_not], store, backend, recorder)
    assert store.load(fits) == Toy(2)
    assert [size for n, size in tried if n == 2] == [8, 4, 2]
    assert [size for n, size in tried if n == 0] == [8, 4, 2, 1], "not less than one frame"
    assert "CUDA out of memory" in outcome.failures[fits_not.key].reason
    assert not outcome.failures[fits_not.key].lasting
    assert [need.gpu_share for need in backend.needs[fits.key]] == [0.25, 1.0, 1.0]


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_network_keeps_to_its_share_of_a_gpu(tmp_path, monkeypatch, share):
    """Four trainings fit a GPU, and one that comes after them has all of it."""
    taken = []
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("training.device.has_card", lambda: True)
    monkeypatch.setattr("torch.cuda.set_per_process_memory_fraction", taken.append)
    monkeypatch.setattr(FinetuneStage, "run", train_at_once)
    monkeypatch.setattr(Remembering, "gpus_per_training", share)
    backend = Remembering()
    assert not execute([training(1)], Store(tmp_path), backend, Recorder()).failures
    assert [need.gpu_share for own in backend.needs.values() for need in own] == taken == [share]
    assert SceneToy().need(share).gpu_share == 0


def test_late_stages_come_first_and_none_without_its_input():
    scene, other = Task(SceneToy(0), "s"), Task(SceneToy(1), "s2")
    late = Task(CollectToy(2), "late", (scene,))
    assert Schedule([scene, other, late], {scene.key}).next() is late
    for tasks in ([late], [late, scene]):
        with pytest.raises(ValueError, match="collect 'late' comes before its input"):
            Schedule(tasks, set())


def test_trainings_are_handed_out_though_no_machine_is_there_now(tmp_path, stages, monkeypatch):
    """One may come; to return would be to forget them."""

    class Empty(InProcess):
        room = Room(gpus=1.0, memory=0.0)

    monkeypatch.setattr(FinetuneStage, "run", train_at_once)
    tasks = [training(1), training(2)]
    failures, _, store = run(tasks, tmp_path, backend=Empty)
    assert not failures
    assert store.finished(tasks) == {task.key for task in tasks}


def test_no_machine_is_asked_for_where_nothing_is_left_to_run(tmp_path, stages):
    class NoMachine(InProcess):
        @property
        def slots(self):
            raise AssertionError("Ray would start")

        cores = room = slots

    tasks = [*diamond(), training(1)]
    failures, _, _ = run(tasks, tmp_path)
    assert failures.keys() == {tasks[-1].key}
    again, recorder, _ = run(tasks, tmp_path, known=failures, backend=NoMachine)
    assert again == failures
    assert [what for what, *_ in recorder.log] == ["failed"]


def test_work_for_a_gpu_does_not_block_the_rest():
    on_gpu, scene = training(1), Task(SceneToy(0), "s")
    schedule = Schedule([on_gpu, scene], set())
    assert schedule.next(gpu=False) is scene
    assert schedule.next(gpu=False) is None
    assert schedule.next(gpu=True) is on_gpu


def test_a_training_notes_its_progress_now_and_then(tmp_path, monkeypatch):
    """One that goes on at epoch 3 of 10; an epoch is 40 steps of a second."""
    clock, noted = [0.0], []
    store, task = Store(tmp_path), training(0)

    def train(stage, *inputs, on_step, **how):
        for step in range(81, 401):
            clock[0] += 1.0
            on_step(step / 40)
            noted.append(store.running_notes([task])[task.key].progress)
        return Toy(1)

    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    monkeypatch.setattr(FinetuneStage, "run", train)
    assert not execute([task], store, InProcess(), Loud()).failures
    assert noted[0] == "epoch 3 of 10, 20 %"
    assert noted[10] == noted[19] == "epoch 3 of 10, 23 %, about 5 min left"
    assert noted[-1] == "epoch 10 of 10, 98 %, about 10 s left"
    assert len(set(noted)) <= 32
