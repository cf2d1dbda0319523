"""What a log file is told of a run: what runs, what is left, and when it ends."""

import heapq
import io
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.command_line.terminal import Terminal
from sweeps.execution.failures import Failure
from sweeps.execution.progress import Running, StageProgress, TimeLeft, about, minutes
from sweeps.search.run import TrialProgress
from sweeps.stages.task import Task
from sweeps.store.local import Note, Store
from tests.forked import GUARD_S
from tests.sweeps.toy import CollectToy, EvaluateToy, Toy, TrainingToy


class Clock:
    """A clock that a test turns."""

    now = 0.0

    def __call__(self):
        return self.now


class Log(io.StringIO):
    """A log file that tells when something is written."""

    def __init__(self):
        super().__init__()
        self.grown = threading.Semaphore(0)

    def write(self, text):
        super().write(text)
        self.grown.release()
        return len(text)

    @property
    def console(self):
        return Terminal(file=self, width=200)


def tasks_of(stage, count, first=0):
    kind = {"collect": CollectToy, "finetune": TrainingToy, "evaluate": EvaluateToy}[stage]
    return [Task(kind(n), f"{stage} {n}") for n in range(first, first + count)]


@given(
    counts=st.lists(st.integers(1, 20), min_size=1, max_size=3),
    lengths=st.lists(st.floats(1, 1000), min_size=3, max_size=3),
    machines=st.integers(1, 5),
)
def test_the_estimate_is_what_machines_take_that_go_on_like_that(counts, lengths, machines):
    """Against a simulation: tasks of one length a stage, as many at once as there are machines."""
    stages = ["collect", "finetune", "evaluate"][: len(counts)]
    tasks = [task for s, n in zip(stages, counts, strict=True) for task in tasks_of(s, n)]
    length = dict(zip(stages, lengths, strict=False))
    clock = Clock()
    running, left = Running(lambda tasks: {}, clock), TimeLeft(tasks)
    waiting, ends, told = list(tasks), [], []
    while waiting or ends:
        while waiting and len(ends) < machines:
            task = waiting.pop(0)
            running.started(task)
            heapq.heappush(
                ends, (clock.now + length[task.stage.name], len(tasks) - len(waiting), task)
            )
        clock.now, _, task = heapq.heappop(ends)
        left.ended(task.stage.name, running.ended(task))
        told.append((clock.now, left.seconds(running, clock.now)))
    longest = max(length[stage] for stage in stages)
    for now, estimate in told:
        # Machines end their last tasks at different times, and wait for none before.
        if estimate is not None:
            assert estimate == pytest.approx(clock.now - now, abs=2 * longest)
    assert told[-1][1] == 0.0


def test_there_is_no_estimate_for_a_stage_that_nothing_is_known_of():
    clock = Clock()
    running = Running(lambda tasks: {}, clock)
    tasks = [*tasks_of("collect", 2), *tasks_of("finetune", 2)]
    left = TimeLeft(tasks)
    for task in tasks[:2]:
        running.started(task)
        clock.now += 10
        left.ended("collect", running.ended(task))
    assert left.seconds(running, clock.now) is None
    left.ended("finetune", None)  # it fell with another
    assert left.seconds(running, clock.now) is None
    running.started(tasks[3])
    clock.now += 60
    left.ended("finetune", running.ended(tasks[3]))
    assert left.seconds(running, clock.now) == 0


def test_what_runs():
    clock = Clock()
    running = Running(lambda tasks: {}, clock)
    assert str(running) == ""
    for task in tasks_of("finetune", 5):
        running.started(task)
    clock.now = 75.4
    named = ", ".join(f"finetune 'finetune {n}' for 1:15" for n in range(2))
    assert str(running) == f"{named}, 3 more"
    assert running.ended(tasks_of("evaluate", 1)[0]) is None


@pytest.mark.parametrize(
    ("seconds", "clock", "estimate"),
    [
        (0, "0:00", "10 s"),
        (59, "0:59", "60 s"),
        (61, "1:01", "1 min"),
        (605, "10:05", "10 min"),
        (3599, "59:59", "60 min"),
        (3600, "1:00:00", "60 min"),
        (36_061, "10:01:01", "10.0 h"),
    ],
)
def test_times(seconds, clock, estimate):
    assert (minutes(seconds), about(seconds)) == (clock, estimate)


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr("sweeps.execution.progress.FIRST_S", 0.01)


class TwoOfThree(StageProgress):
    def now(self):
        return "two of three"


def test_lines_come_while_the_driver_waits(at_once, tmp_path):
    log = Log()
    with TwoOfThree(log.console, (), Store(tmp_path)):
        assert log.grown.acquire(timeout=GUARD_S)
        assert log.grown.acquire(timeout=GUARD_S)
    written = log.getvalue()
    assert set(written.splitlines()) == {"   0:00  two of three"}
    assert "progress lines" not in {thread.name for thread in threading.enumerate()}


def test_a_terminal_has_bars_and_no_lines(at_once, tmp_path):
    console = Terminal(file=io.StringIO(), force_terminal=True)
    with TwoOfThree(console, (), Store(tmp_path)):
        assert "progress lines" not in {thread.name for thread in threading.enumerate()}


def test_a_sweep_in_a_log(at_once, tmp_path):
    log = Log()
    store = Store(tmp_path)
    tasks = [*tasks_of("collect", 2), *tasks_of("finetune", 3)]
    store.save(tasks[0], Toy(), 1.0)
    with StageProgress(log.console, tasks, store) as progress:
        progress.started(tasks[1])
        while "now collect 'collect 1' for 0:00" not in log.getvalue():
            assert log.grown.acquire(timeout=GUARD_S)
        assert "collect 1 of 2, finetune 0 of 3; now" in log.getvalue()
        progress.finished(tasks[1])
        assert "\ncollect: 2 done\n" in log.getvalue()
        progress.started(tasks[2])
        progress.finished(tasks[2])
        progress.failed(tasks[3], Failure("no points"))
        while "finetune 2 of 3; about 10 s left" not in log.getvalue():
            assert log.grown.acquire(timeout=GUARD_S)


def test_a_search_in_a_log(at_once, tmp_path):
    log, store = Log(), Store(tmp_path)
    training = Task(TrainingToy(), "all")
    with TrialProgress(log.console, 20, store) as progress, store.running(training, Note()) as note:
        note("epoch 2 of 9, 20 %")
        progress.started(training)
        now = "trials 0 of 20; now finetune 'all' for 0:00 (epoch 2 of 9, 20 %)\n"
        while now not in log.getvalue():
            assert log.grown.acquire(timeout=GUARD_S)
        progress.finished(training)
        progress.count_finished(8)  # a training is no measure of what is to come
        while "trials 8 of 20\n" not in log.getvalue():
            assert log.grown.acquire(timeout=GUARD_S)
        progress.count_finished(16)
        while "trials 16 of 20; about 10 s left" not in log.getvalue():
            assert log.grown.acquire(timeout=GUARD_S)
