"""The store at a URL: two caches stand for two machines."""

import errno
import json
import pickle
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pandas as pd
import pytest
from fsspec.registry import known_implementations

from sweeps.configuration.grid import read_sweep
from sweeps.stages.task import Task
from sweeps.store import checkpoint_mirror
from sweeps.store.local import Note, Store
from sweeps.store.open import open_store, reference, store_of
from sweeps.store.remote import RemoteStore
from sweeps.store.result_folder import DamagedResult, Ran, Record, _digest_of_content
from tests.refused import refused
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import TrainingToy, flip_bit, keep_in, texts, write

TASK = Task(TrainingToy(1), "a")


@pytest.fixture(params=["memory", "folder"])
def url(request, tmp_path, monkeypatch):
    """A store's URL on two kinds of filesystems."""
    if request.param == "folder":
        monkeypatch.setitem(fsspec.config.conf, "file", {"auto_mkdir": True})
        return f"file://{tmp_path / 'remote'}"
    return f"memory://{uuid.uuid4().hex}"


@pytest.fixture
def machine(url, tmp_path):
    """Makes the store as a machine of that name sees it."""
    return lambda name: RemoteStore(tmp_path / name, url)


@dataclass(frozen=True)
class Kept:
    table: pd.DataFrame
    array: np.ndarray
    n: int
    large: Any = None


@pytest.fixture(autouse=True)
def kept(monkeypatch):
    keep_in(monkeypatch, type(TASK.stage), Kept)


def value(n=3, large=None):
    return Kept(pd.DataFrame({"a": [1, n]}), np.full(4, n), n, large)


def files_at(url):
    filesystem, root = fsspec.url_to_fs(url)
    return [path.removeprefix(f"{root}/") for path in filesystem.find(root)]


def test_what_one_machine_saves_another_loads(machine):
    one, other = machine("one"), pickle.loads(pickle.dumps(machine("other")))
    saved = value(large=np.arange(200_000))
    assert not other.has(TASK)
    assert other.finished([TASK]) == set()
    one.save(TASK, saved, seconds=1.5, ran=Ran(node="n1"))
    assert other.has(TASK)
    assert other.finished([TASK, Task(TrainingToy(), "b")]) == {TASK.key}
    assert other.record(TASK) == Record(label="a", seconds=1.5, node="n1")
    assert not other.path(TASK).exists(), "what is asked about a result is not copied"
    found = other.load(TASK)
    assert isinstance(found.large, np.memmap)
    np.testing.assert_array_equal(found.array, saved.array)
    pd.testing.assert_frame_equal(found.table, saved.table)
    assert other.read(TASK, lambda kept: kept.n) == 3
    assert other.record(TASK) == one.record(TASK)


def test_what_is_here_is_not_copied_again(machine, url):
    machine("one").save(TASK, value(), seconds=0.0)
    machine("other").load(TASK)
    filesystem, root = fsspec.url_to_fs(url)
    filesystem.rm(root, recursive=True)
    assert machine("other").load(TASK).n == 3
    assert not machine("other").has(TASK), "others would not find it"
    with pytest.raises(FileNotFoundError):
        machine("third").load(TASK)
    assert not any(Store(machine("third").folder).contents())


@pytest.mark.parametrize("step", ["put", "put_file"])
def test_a_copy_that_breaks_off_makes_no_result(machine, url, monkeypatch, step):
    def broken(*args, **kwargs):
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    with monkeypatch.context() as patch:
        patch.setattr(type(fsspec.url_to_fs(url)[0]), step, broken)
        with pytest.raises(OSError, match="unreachable"):
            machine("one").save(TASK, value(), seconds=0.0)
    other = machine("other")
    assert not other.has(TASK)
    assert other.finished([TASK]) == set()
    machine("one").save(TASK, value(4), seconds=0.0)
    assert other.load(TASK).n == 3, "what had been saved already was copied"


def test_two_machines_that_save_at_once_leave_one_whole_result(machine, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(RemoteStore, "has", lambda store, task: False)  # neither sees the other's
        for n, name in enumerate(("one", "other")):
            machine(name).save(TASK, value(n), seconds=float(n))
    found = machine("third").load(TASK)
    n = found.n
    assert found.array.tolist() == [n] * 4
    assert found.table["a"].tolist() == [1, n]
    assert machine("third").record(TASK).seconds == n


def changed(data):
    return data[:50] + bytes([data[50] ^ 4]) + data[51:]


def of_another(data):
    """What the store writes at another place."""
    content = json.loads(data) | {"place": "finetune/b"}
    del content["digest"]
    return json.dumps(content | {"digest": _digest_of_content(content)}).encode()


@pytest.mark.parametrize(
    ("name", "harm", "told", "read"),
    [
        ("array.npy", lambda data: None, "a file is missing", RemoteStore.load),
        ("array.npy", lambda data: b"few", "array.npy has 3 bytes", RemoteStore.load),
        ("array.npy", changed, "array.npy is not what was written", RemoteStore.load),
        ("table.parquet", changed, "table.parquet is not what was written", RemoteStore.load),
        ("result.json", changed, "result.json is not what was written", RemoteStore.record),
        ("result.json", of_another, "its result.json is of finetune/b", RemoteStore.load),
        ("result.json", of_another, "its result.json is of finetune/b", RemoteStore.record),
    ],
)
def test_what_is_damaged_at_the_url_is_removed_there(machine, url, name, harm, told, read):
    machine("one").save(TASK, value(), seconds=0.0)
    filesystem, root = fsspec.url_to_fs(url)
    (path,) = (path for path in filesystem.find(root) if path.endswith(name))
    content = harm(filesystem.cat_file(path))
    filesystem.rm_file(path)
    if content is not None:
        filesystem.pipe_file(path, content)
    with pytest.raises(DamagedResult, match=f"{TASK.key} is damaged: {told}"):
        read(machine("other"), TASK)
    assert not machine("other").path(TASK).exists()
    assert not machine("third").has(TASK)
    assert not machine("third").contents()
    machine("other").save(TASK, value(5), seconds=0.0)
    assert machine("third").load(TASK).n == 5


def test_a_damaged_copy_is_replaced(machine, caplog):
    machine("one").save(TASK, value(), seconds=0.0)
    other = machine("other")
    other.load(TASK)
    flip_bit(other.path(TASK) / "array.npy", 0.5)
    assert other.load(TASK).array.tolist() == [3] * 4
    assert "array.npy is not what was written" in caplog.text
    assert machine("third").has(TASK)
    flip_bit(other.path(TASK) / "result.json", 0.5)
    assert other.record(TASK).seconds == 0.0


def test_a_damaged_copy_is_not_handed_on(machine, url):
    one = machine("one")
    one.save(TASK, value(), seconds=0.0)
    filesystem, root = fsspec.url_to_fs(url)
    filesystem.rm(f"{root}/{TASK.stage.name}", recursive=True)
    flip_bit(one.path(TASK) / "array.npy", 0.5)
    one.save(TASK, value(), seconds=0.0)
    assert machine("other").load(TASK).array.tolist() == [3] * 4


def test_another_machine_goes_on_with_a_task(machine, url):
    one, other = machine("one"), machine("other")
    with suppress(KeyError), one.working_folder(TASK) as folder:
        write(folder / "last.pt", "1")
        write(folder / "last.pt", "2")
        raise KeyError
    with other.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "2"}
        write(folder / "last.pt", "3")
    with one.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "3"}, "not its own older ones"
    one.save(TASK, value(), seconds=0.0)
    one.discard(TASK)
    assert not any("working" in path for path in files_at(url))
    with machine("third").working_folder(TASK) as folder:
        assert texts(folder) == {}


def test_checkpoints_are_copied_while_the_task_runs(machine, url, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint_mirror, "SECONDS", 0.01)
    store = machine("one")
    filesystem, root = fsspec.url_to_fs(url)
    place = f"{root}/{TASK.stage.name}/.{TASK.key}.working"
    there = tmp_path / "there"
    found = []
    with store.working_folder(TASK) as folder:
        for n in ("1", "2", "3"):
            write(folder / "last.pt", n)
            give_up = time.monotonic() + 60
            while {"last.pt": n} not in found:
                assert time.monotonic() < give_up
                checkpoint_mirror.fetch(filesystem, place, there)
                found = [texts(attempt) for attempt in there.glob("[!.]*")]
    assert len(files_at(url)) == 1, "what was replaced is removed"


def test_a_remote_place_that_does_not_answer_stops_no_training(machine, monkeypatch, caplog):
    monkeypatch.setattr(checkpoint_mirror, "_copy", broken)
    with machine("one").working_folder(TASK) as folder:
        write(folder / "last.pt", "1")
    assert "no route" in caplog.text


def broken(*args, **kwargs):
    raise ConnectionError("no route")


def test_what_was_trained_without_the_remote_place_is_kept(machine, monkeypatch):
    """It does not answer while both machines go on with what they have of an attempt."""
    one, other = machine("one"), machine("other")
    with one.working_folder(TASK) as folder:
        write(folder / "last.pt", "1")
    for store, begun in ((one, "1"), (other, "1"), (one, "1, one"), (other, "1, other")):
        with monkeypatch.context() as patch, store.working_folder(TASK) as folder:
            assert texts(folder) == {"last.pt": begun}
            patch.setattr(checkpoint_mirror, "_copy", broken)
            name = "one" if store is one else "other"
            write(folder / "last.pt", f"1, {name}")
    with one.working_folder(TASK) as folder:
        write(folder / "last.pt", "2")
    with other.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "2"}, "what another machine left last counts"


def test_a_fetch_that_breaks_off_spoils_nothing(machine, url, monkeypatch):
    one, other = machine("one"), machine("other")
    with one.working_folder(TASK) as folder:
        write(folder / "last.pt", "whole")

    def half(filesystem, place, path, **kwargs):
        Path(path).write_text("wh")
        raise ConnectionError("no route")

    with monkeypatch.context() as patch:
        patch.setattr(type(fsspec.url_to_fs(url)[0]), "get_file", half)
        with pytest.raises(ConnectionError):
            other.working_folder(TASK).__enter__()
    assert list(other.attempts(TASK).iterdir()) == []
    with other.working_folder(TASK) as folder:
        assert texts(folder) == {"last.pt": "whole"}


def test_notes_and_references_are_seen_by_all(machine, url):
    one, other = machine("one"), machine("other")
    filesystem, root = fsspec.url_to_fs(url)
    with one.running(TASK, Note("n1")):
        assert other.running_notes([TASK]) == {TASK.key: Note("n1")}
        filesystem.pipe_file(f"{root}/{TASK.stage.name}/{one.note(TASK).name}", b'{"host": ')
        assert other.running_notes([TASK]) == {}, "it is not whole"
    assert other.running_notes([TASK]) == {}
    lost = one.running(TASK, Note())
    lost.__enter__()  # and never left
    assert other.running_notes([TASK]) == {TASK.key: Note()}
    other.end_running(iter([TASK]))
    assert one.running_notes([TASK]) == {}
    one.refer("tiny", {"b", "a"})
    assert other.references() == {"tiny": {"a", "b"}}
    with refused(("--forget", "", "tiny"), "'odd'"):
        other.forget("tiny", "odd")
    other.forget("tiny")
    assert one.references() == {}


def test_a_sweep_at_a_url_cannot_be_locked_out(machine, monkeypatch):
    monkeypatch.setattr("sweeps.store.lock._PATIENCE_S", 0.05)
    store = machine("one")
    with store.in_use(), refused((str(store.folder), "", "")):
        Store(store.folder).exclusive().__enter__()
    with refused((store.public_name, "", ""), "--unlocked"):
        store.exclusive()


def test_the_store_of_a_configuration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "runs" / "store"
    runs = own.parent.relative_to(tmp_path)
    assert open_store(None, runs) == Store(own)
    assert open_store("shared", runs) == Store(tmp_path / "shared")
    assert open_store("file:///data/store", runs) == Store(Path("/data/store"))
    assert open_store("memory://a/b/", runs) == RemoteStore(own, "memory://a/b")
    assert open_store("memory://a", runs, runs / "c") == RemoteStore(own.parent / "c", "memory://a")
    assert not list(tmp_path.iterdir())


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    known = {"class": "no_such_package.Files", "err": "Install it"}
    monkeypatch.setitem(known_implementations, "odd", known)
    with refused(("", "store", ""), "pip install no_such_package"):
        open_store("odd://bucket/a", tmp_path)
    with refused(("", "store", "s33://bucket/a")):
        open_store("s33://bucket/a", tmp_path)


def test_a_place_that_cannot_be_read_is_named(tmp_path, monkeypatch):
    def denied(*args, **kwargs):
        raise PermissionError("no credentials")

    monkeypatch.setattr("fsspec.implementations.memory.MemoryFileSystem.find", denied)
    with refused(("", "store", ""), "memory://a: cannot be read: PermissionError: no credentials"):
        open_store("memory://a", tmp_path)


def sweep(folder, **settings):
    return read_sweep(write_sweep(folder, placement="line", **settings))


def test_sweeps_of_one_name_in_two_folders_refer_apart(tmp_path):
    here, there = sweep(tmp_path), sweep(tmp_path, output=str(tmp_path / "other"))
    assert store_of(here) == Store(tmp_path / "runs/store")
    remote = sweep(tmp_path, store={"url": "memory://b/", "cache": str(tmp_path / "c")})
    assert store_of(remote) == RemoteStore(tmp_path / "c", "memory://b")
    assert reference(here) != reference(there)
    assert reference(here) == reference(sweep(tmp_path, output=f"{tmp_path}/./runs"))
    assert reference(here).startswith("grid.")
    assert reference(here, "pretrain") != reference(here)
    assert Path(reference(here)).name == reference(here)
