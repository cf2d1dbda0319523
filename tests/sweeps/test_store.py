"""The store on a disk: results are whole or not there, whoever dies or writes beside."""

import errno
import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from lidarplace import PAPER_PLACEMENTS, Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.recorded import RecordedRig
from sweeps.stages.task import Task
from sweeps.store.local import Note, Store
from sweeps.store.lock import is_locked, locked
from sweeps.store.result_folder import DamagedResult, Ran, Record
from tests.refused import refused
from tests.sweeps.toy import PogToy, SceneToy, Toy, flip_bit, keep_in, result, texts, write

ROOT = Path(__file__).parents[2]
TASK = Task(SceneToy(1), "a")
OTHER = Task(SceneToy(2), "b")
FORK = multiprocessing.get_context("fork")


@dataclass(frozen=True)
class Kept:
    table: pd.DataFrame
    array: np.ndarray
    n: int
    roi: Roi
    state_dict: Any = None
    by_name: Any = None
    large: Any = None
    empty: Any = None


ROI = Roi((0, 4), (-2, 2), (0, 2), 0.5)


def value(n=3, **more):
    return Kept(pd.DataFrame({"a": [1, n]}), np.full(4, n), n, ROI, **more)


@pytest.fixture
def store(tmp_path, monkeypatch):
    keep_in(monkeypatch, type(TASK.stage), Kept)
    return Store(tmp_path / "store")


def names(store):
    """All that lies beside the results."""
    folder = store.folder / TASK.stage.name
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def test_what_was_saved_is_loaded(store):
    by_name = {"Car": np.zeros(2), "Big Van": np.ones(3)}
    saved = value(state_dict={"w": torch.ones(2)}, by_name=by_name)
    assert not store.has(TASK)
    store.save(TASK, saved, 1.5, Ran(node="n1", peak_memory=12))
    found = store.load(TASK)
    assert type(found) is Kept
    pd.testing.assert_frame_equal(found.table, saved.table)
    np.testing.assert_array_equal(found.array, saved.array)
    assert torch.equal(found.state_dict["w"], torch.ones(2))
    arrays = {name: array.tolist() for name, array in found.by_name.items()}
    assert arrays == {"Car": [0, 0], "Big Van": [1, 1, 1]}
    assert (found.n, found.roi, found.large) == (3, ROI, None)
    assert store.record(TASK) == Record(label="a", seconds=1.5, node="n1", peak_memory=12)
    store.save(TASK, value(4), seconds=9.0)
    assert store.load(TASK).n == 3, "what is there stays"
    assert names(store) == [TASK.key]


def test_a_log_is_loaded_with_its_rigs(store, monkeypatch):
    keep_in(monkeypatch, type(TASK.stage), BoxLog)
    rig = RecordedRig(("a", "b", "c", "d"), PAPER_PLACEMENTS["line"])
    log = BoxLog(pd.DataFrame({"frame": [1]}), pd.DataFrame({"frame": [1]}), rigs={"town": rig})
    store.save(TASK, log, seconds=0.0)
    assert store.load(TASK).rigs == {"town": rig}


def test_only_what_is_asked_for_is_loaded(store, monkeypatch):
    store.save(TASK, value(), seconds=0.0)
    monkeypatch.delattr("pandas.read_parquet")
    assert store.read(TASK, lambda kept: (kept.n, kept.array.tolist())) == (3, [3] * 4)
    with pytest.raises(KeyError, match="such"):
        store.read(TASK, lambda kept: kept.such)


def test_a_field_may_be_missing_that_has_a_default(store):
    """Such as in a result of before."""
    store.save(TASK, result(n=3, table=pd.DataFrame()), seconds=0.0)
    assert store.read(TASK, lambda kept: (kept.n, kept.large)) == (3, None)
    with pytest.raises(KeyError, match=r"holds no array; it holds \['n', 'table'\]"):
        store.load(TASK)


def test_large_arrays_stay_on_disk(store):
    store.save(TASK, value(large=np.arange(200_000)), seconds=0.0)
    found = store.load(TASK)
    assert isinstance(found.large, np.memmap)
    assert not found.large.flags.writeable
    assert not isinstance(found.array, np.memmap)


@pytest.fixture
def listed(monkeypatch):
    """The folders that are listed."""
    calls, listdir = [], os.listdir
    monkeypatch.setattr("os.listdir", lambda path: (calls.append(path), listdir(path))[1])
    return calls


def test_a_stage_is_listed_once_for_all_its_tasks(store, listed):
    tasks = [Task(SceneToy(n), str(n)) for n in range(50)]
    for task in tasks[:3]:
        store.save(task, Toy(1), seconds=0.0)
    listed.clear()
    assert store.finished([*tasks, Task(PogToy(), "p")]) == {task.key for task in tasks[:3]}
    assert len(listed) == 2


def full_disk(*args, **kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    "step",
    [
        "pathlib.Path.mkdir",
        "pandas.DataFrame.to_parquet",
        "numpy.save",
        "torch.save",
        "pathlib.Path.write_text",
        "sweeps.store.result_folder.sync",
        "sweeps.store.whole.sync",
        "pathlib.Path.rename",
    ],
)
def test_a_full_disk_at_any_step_leaves_nothing(store, monkeypatch, step):
    saved = value(state_dict={"w": torch.ones(2)})
    with monkeypatch.context() as patch:
        patch.setattr(step, full_disk)
        with pytest.raises(OSError, match="No space left") as error:
            store.save(TASK, saved, seconds=0.0)
    if step != "pathlib.Path.mkdir":  # not yet there
        assert re.search(r"[\d.]+ MB are free on /", str(error.value))
        assert error.value.filename == str(store.path(TASK))
    assert not store.has(TASK)
    assert store.finished([TASK]) == set()
    assert names(store) == []
    store.save(TASK, saved, seconds=0.0)
    assert store.load(TASK).n == 3


def test_what_cannot_be_stored_leaves_nothing(store):
    with pytest.raises(TypeError):
        store.save(TASK, replace(value(), n=object()), seconds=0.0)
    assert names(store) == []
    with pytest.raises(FileNotFoundError):
        store.load(TASK)


def killed_while_saving(folder):
    os.fsync = lambda descriptor: os.kill(os.getpid(), signal.SIGKILL)
    Store(folder).save(TASK, value(), seconds=0.0)


def ends_by_its_own_kill(function, folder):
    process = FORK.Process(target=function, args=(folder,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL


def test_a_process_killed_while_it_saves_leaves_no_result(store):
    ends_by_its_own_kill(killed_while_saving, store.folder)
    assert not store.has(TASK)
    assert [entry.kind for entry in store.contents()] == ["partial"]
    store.save(TASK, value(), seconds=0.0)
    assert store.load(TASK).n == 3


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        (lambda folder: (folder / "array.npy").unlink(), "array.npy is missing"),
        (lambda folder: os.truncate(folder / "array.npy", 100), "array.npy has 100 bytes, 160"),
        (lambda folder: (folder / "result.json").unlink(), "result.json is missing"),
        (lambda folder: os.truncate(folder / "result.json", 30), "result.json is not what"),
        (lambda folder: (folder / "result.json").write_text("[]"), "result.json is not what"),
        (
            lambda folder: shutil.copytree(folder.parent / OTHER.key, folder, dirs_exist_ok=True),
            f"its result.json is of scene/{OTHER.key}",
        ),
    ],
)
def test_a_damaged_result_is_refused_by_name(store, harm, told):
    store.save(TASK, value(), seconds=0.0)
    store.save(OTHER, value(), seconds=0.0)
    harm(store.path(TASK))
    with pytest.raises(ValueError, match=told) as error:
        store.load(TASK)
    assert str(error.value).startswith(f"{store.path(TASK)} is damaged")
    assert not store.has(TASK)
    store.save(TASK, value(), seconds=0.0)
    assert store.load(TASK).n == 3


def with_every_kind_of_file():
    weights = {"weight": torch.arange(1000.0)}
    return value(large=np.arange(200_000), state_dict=weights, empty=np.empty(0))


@pytest.mark.parametrize(
    ("name", "read"),
    [
        *((f"{name}.npy", Store.load) for name in ("array", "large", "empty")),
        ("table.parquet", Store.load),
        ("state_dict.pt", Store.load),
        ("result.json", Store.load),
        ("result.json", Store.record),
    ],
)
def test_one_changed_bit_anywhere_is_a_damage(store, name, read):
    for place in np.linspace(0, 1, 7):
        store.save(TASK, with_every_kind_of_file(), seconds=1.0)
        assert store.finished([TASK]) == {TASK.key}
        flip_bit(store.path(TASK) / name, place)
        with pytest.raises(DamagedResult, match=f"{TASK.key} is damaged: {name} is not what was"):
            read(store, TASK)
        assert not store.finished([TASK])
        assert not store.contents()


def test_what_is_not_read_is_not_looked_at(store):
    store.save(TASK, with_every_kind_of_file(), seconds=1.0)
    flip_bit(store.path(TASK) / "large.npy", 0.5)
    assert store.read(TASK, lambda kept: (kept.n, kept.table))[0] == 3
    with pytest.raises(DamagedResult):
        store.read(TASK, lambda kept: kept.large)


def test_plain_data_survive_the_digest(store):
    plain = {"none": None, "nan": float("nan"), "keys": {1: "a", 2: "b"}, "text": 'µ ∑ "', "f": 0.1}
    store.save(TASK, replace(value(), n=plain), seconds=1.0)
    found = store.load(TASK).n
    assert found["keys"] == {"1": "a", "2": "b"}
    assert found["text"] == plain["text"]
    assert found["f"] == 0.1
    assert np.isnan(found["nan"])


def test_a_damaged_result_that_cannot_be_removed_is_told(store, monkeypatch):
    store.save(TASK, value(), seconds=1.0)
    flip_bit(store.path(TASK) / "array.npy", 0.5)

    def read_only(*args, **kwargs):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "rename", read_only)
    with pytest.raises(OSError, match=r"array.npy is not .* but: Read-only file system"):
        store.load(TASK)


MANY = [Task(SceneToy(n), str(n)) for n in range(15)]


def save_all(folder, writer, gate):
    gate.wait()
    for task in MANY:
        Store(folder).save(task, value(writer), seconds=float(writer))


def test_two_processes_save_the_same_tasks_while_a_third_loads_them(store):
    gate = FORK.Barrier(2)
    writers = [FORK.Process(target=save_all, args=(store.folder, n, gate)) for n in (1, 2)]
    for process in writers:
        process.start()
    open_tasks = {task.key: task for task in MANY}
    while open_tasks:
        for key in store.finished(open_tasks.values()):
            task = open_tasks.pop(key)
            found = store.load(task)
            writer = found.n
            assert found.array.tolist() == [writer] * 4
            assert found.table["a"].tolist() == [1, writer]
            assert store.record(task).seconds == writer
        alive = any(process.is_alive() for process in writers)
        assert alive or store.finished(open_tasks.values()) == set(open_tasks)
    for process in writers:
        process.join(60)
        assert process.exitcode == 0
    assert names(store) == sorted(task.key for task in MANY)


def test_a_stopped_task_finds_its_checkpoints(store):
    with suppress(KeyError), store.working_folder(TASK) as folder:
        assert texts(folder) == {}
        write(folder / "last.pt", "1")
        raise KeyError
    with store.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "1"}
        write(folder / "last.pt", "2")
    with store.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "2"}, "the latest attempt counts"
    store.discard(TASK)
    assert names(store) == []
    with store.working_folder(TASK) as folder:
        assert texts(folder) == {}


def test_two_attempts_at_once_do_not_disturb_each_other(store):
    with store.working_folder(TASK) as one:
        write(one / "last.pt", "1")
        with store.working_folder(TASK) as other:
            write(one / "last.pt", "2")
            assert texts(other) == {"last.pt": "1"}
            write(other / "last.pt", "slow")
            assert texts(one) == {"last.pt": "2"}
            store.discard(TASK)
            with pytest.raises(FileNotFoundError):
                write(other / "last.pt", "3")


def killed_while_copying(folder):
    def half(source, target):
        Path(target).write_bytes(Path(source).read_bytes()[:2])
        os.kill(os.getpid(), signal.SIGKILL)

    shutil.copy2 = half
    Store(folder).working_folder(TASK).__enter__()


def test_a_process_killed_while_it_takes_over_checkpoints_spoils_none(store):
    with store.working_folder(TASK) as folder:
        write(folder / "last.pt", "whole")
    ends_by_its_own_kill(killed_while_copying, store.folder)
    for _ in range(2):
        with store.working_folder(TASK) as folder:
            assert texts(folder) == {"last.pt": "whole"}
    store.discard(TASK)
    assert names(store) == []


@pytest.mark.parametrize("step", ["shutil.copy2", "sweeps.store.local.sync", "pathlib.Path.rename"])
def test_a_full_disk_while_checkpoints_are_taken_over_leaves_nothing(store, monkeypatch, step):
    with store.working_folder(TASK) as folder:
        write(folder / "last.pt", "whole")
    with monkeypatch.context() as patch:
        patch.setattr(step, full_disk)
        with pytest.raises(OSError, match="No space left"):
            store.working_folder(TASK).__enter__()
    assert list(store.attempts(TASK).iterdir()) == [folder]


def test_a_note_tells_that_a_task_runs(store):
    other = Task(PogToy(), "b")
    with suppress(KeyError), store.running(TASK, Note("n1", 7)):
        assert store.running_notes([TASK, other]) == {TASK.key: Note("n1", 7)}
        raise KeyError
    assert store.running_notes([TASK, other]) == {}
    with store.running(TASK, Note()):
        store.discard(TASK)
        assert store.running_notes([TASK]) == {}


@pytest.mark.parametrize("text", ["", '{"host": "n', "\0\0\0"])
def test_a_note_that_is_not_whole_is_left_out(store, text):
    with store.running(TASK, Note("n1")):
        store.note(TASK).write_text(text)
        assert store.running_notes([TASK]) == {}


def test_a_driver_ends_what_a_killed_one_ran(store, listed):
    tasks = [Task(SceneToy(n), str(n)) for n in range(20)]
    lost = [store.running(task, Note()) for task in tasks[:3]]
    for block in lost:
        block.__enter__()  # and never left
    listed.clear()
    store.end_running(iter([*tasks[1:], Task(PogToy(), "p")]))
    assert len(listed) == 2
    assert store.running_notes(tasks) == {tasks[0].key: Note()}


def test_a_sweep_refers_to_its_last_configuration(store):
    assert store.references() == {}
    store.refer("one", ["a", "b"])
    store.refer("two", ["b"])
    store.refer("one", ["c"])
    assert store.references() == {"one": {"c"}, "two": {"b"}}
    store.forget("two")
    assert store.references() == {"one": {"c"}}
    with refused(("--forget", "", "one"), "'two'"):
        store.forget("one", "two")
    assert store.references() == {"one": {"c"}}, "all or none"


@pytest.mark.parametrize("text", ["", '["a"', json.dumps({"a": 1})])
def test_a_damaged_reference_is_not_taken_for_none(store, text):
    store.refer("one", ["a"])
    store.sweep_file("one").write_text(text)
    with refused(("one.json", "", text)):
        store.references()
    store.forget("one")
    assert store.references() == {}


def test_a_killed_driver_holds_no_lock(store, monkeypatch):
    monkeypatch.setattr("sweeps.store.lock._PATIENCE_S", 0.05)
    code = f"""
import sys, time
from pathlib import Path
from sweeps.store.lock import locked
from tests.refused import refused
with locked(Path({str(store.folder)!r}), alone=False):
    print("held", flush=True)
    time.sleep(60)
"""
    driver = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE)
    try:
        assert driver.stdout.readline() == b"held\n"
        with store.in_use():
            pass
        with refused((str(store.folder), "", "")):
            store.exclusive().__enter__()
    finally:
        driver.kill()
        driver.communicate(timeout=60)
    with store.exclusive(), refused((str(store.folder), "", "")):
        store.exclusive().__enter__()


def test_a_look_at_the_lock_refuses_no_driver(tmp_path, monkeypatch):
    look = ExitStack()
    look.enter_context(locked(tmp_path, alone=False))
    monkeypatch.setattr("time.sleep", lambda seconds: look.close())  # it ends while a driver waits
    with locked(tmp_path, alone=True):
        assert is_locked(tmp_path)


def test_looks_do_not_see_each_other(tmp_path):
    assert not is_locked(tmp_path / "none")
    assert not is_locked(tmp_path)
    assert not list(tmp_path.iterdir()), "a look makes nothing"
    with locked(tmp_path, alone=True):
        assert is_locked(tmp_path)
    with locked(tmp_path, alone=False):
        assert not is_locked(tmp_path)


def test_sizes_are_told_while_a_task_ends(store, monkeypatch):
    with store.running(TASK, Note()):
        note, stat = store.note(TASK), Path.stat

        def gone(path, **kwargs):
            if path == note:
                raise FileNotFoundError(errno.ENOENT, "gone", path)
            return stat(path, **kwargs)

        monkeypatch.setattr(Path, "stat", gone)
        assert [entry.size for entry in store.contents()] == [0]
