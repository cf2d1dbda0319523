"""Cleaning removes what no sweep refers to, and nothing else."""

import os
import tempfile
import uuid
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps.commands.clean import app
from sweeps.stages.task import Task
from sweeps.store.cleaning import clean_store
from sweeps.store.entries import size_of
from sweeps.store.local import Note, Store
from sweeps.store.remote import RemoteStore
from tests.sweeps.toy import SceneToy, call, result


def tasks_of(*names):
    return [Task(SceneToy(name), name) for name in names]


def saved(store, *names, size=1000):
    tasks = tasks_of(*names)
    for task in tasks:
        store.save(task, result(n=np.zeros(size, np.uint8)), seconds=0.0)
    return tasks


@pytest.fixture(params=["folder", "memory"])
def store(request, tmp_path):
    if request.param == "folder":
        return Store(tmp_path / "store")
    return RemoteStore(tmp_path / "cache", f"memory://{uuid.uuid4().hex}")


def kinds(entries):
    return sorted(entry.kind for entry in entries)


def test_what_no_sweep_refers_to_is_removed(store):
    a, b, c, d = saved(store, "a", "b", "c", "d")
    store.refer("one", [a.key])
    store.refer("two", [a.key, b.key, "not computed yet"])
    planned = clean_store(store, dry_run=True)
    assert store.finished([a, b, c, d]) == {a.key, b.key, c.key, d.key}
    cleaned = clean_store(store)
    assert cleaned == planned
    assert {entry.key for entry in cleaned.removed} == {c.key, d.key}
    assert store.finished([a, b, c, d]) == {a.key, b.key}
    assert cleaned.kept_bytes == size_of(store.contents()) > 2000
    store.refer("two", [a.key])  # its configuration has changed
    assert [entry.key for entry in clean_store(store).removed] == [b.key]
    assert not clean_store(store).removed


def test_what_killed_processes_left_is_removed(store):
    finished, going, gone = tasks_of("done", "going", "gone")
    saved(store, "done")
    store.refer("one", [finished.key, going.key])
    for task in (finished, going, gone):
        with store.working_folder(task) as folder:
            (folder / "last.pt").write_text("1")
    lost = store.running(going, Note("n1"))
    lost.__enter__()  # and never left
    half = store.folder / "scene" if not isinstance(store, RemoteStore) else None
    if half:
        (half / f".{gone.key}.n1-7-0123abcd.part").mkdir()
    cleaned = clean_store(store)
    expected = ["running", "working", "working"]
    assert kinds(cleaned.leftovers) == (["partial", *expected] if half else expected)
    assert cleaned.removed == cleaned.leftovers
    assert kinds(store.contents()) == ["result", "working"]
    with store.working_folder(going) as folder:
        assert (folder / "last.pt").read_text() == "1"


def test_an_upload_that_broke_off_is_a_leftover(tmp_path, monkeypatch):
    store = RemoteStore(tmp_path / "cache", f"memory://{uuid.uuid4().hex}")
    with monkeypatch.context() as patch:
        patch.setattr("fsspec.implementations.memory.MemoryFileSystem.put_file", None)
        with pytest.raises(TypeError):
            saved(store, "a")
    filesystem, root = store._remote()
    filesystem.pipe_file(f"{root}/scene/{tasks_of('a')[0].key}/0123/array.npy", b"some")
    store.refer("one", [tasks_of("a")[0].key])
    assert kinds(clean_store(store).removed) == ["partial"]
    assert store.contents() == []


def test_a_quota_spares_what_was_used_last(tmp_path):
    store = Store(tmp_path)
    a, b, c, d = saved(store, "a", "b", "c", "d")
    store.refer("one", [d.key])
    for age, task in enumerate((d, c, b, a)):
        os.utime(store.path(task), (1e9 - age, 1e9 - age))
    total = size_of(store.contents())
    assert not clean_store(store, total).removed
    store.read(a, lambda value: None)  # the oldest becomes the newest
    assert [entry.key for entry in clean_store(store, total - 1).removed] == [b.key]
    assert [entry.key for entry in clean_store(store, 0).removed] == [c.key, a.key]
    assert store.finished([a, b, c, d]) == {d.key}


def test_a_remote_quota_spares_what_was_stored_last(tmp_path):
    store = RemoteStore(tmp_path / "cache", f"memory://{uuid.uuid4().hex}")
    a, b = saved(store, "a", "b")
    cleaned = clean_store(store, size_of(store.contents()) - 1)
    assert [entry.key for entry in cleaned.removed] == [a.key]
    assert store.finished([a, b]) == {b.key}


NAMES = st.sets(st.sampled_from("abcdefg"))


@settings(max_examples=25)
@given(
    stored=NAMES,
    sweeps=st.dictionaries(st.sampled_from(["one", "two", "three"]), NAMES),
    quota=st.none() | st.integers(0, 12_000),
    times=st.lists(st.floats(0, 4e9), min_size=7, max_size=7),  # a clock that jumps
)
def test_what_a_sweep_refers_to_is_never_removed(stored, sweeps, quota, times):
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        tasks = dict(zip("abcdefg", tasks_of(*"abcdefg"), strict=True))
        saved(store, *sorted(stored))
        for name, time in zip("abcdefg", times, strict=True):
            if name in stored:
                os.utime(store.path(tasks[name]), (time, time))
        for name, names in sweeps.items():
            store.refer(name, [tasks[n].key for n in names])
        size = size_of(store.contents())
        cleaned = clean_store(store, quota)
        left = {name for name in stored if store.has(tasks[name])}
        referred = set().union(*sweeps.values()) & stored
        assert referred <= left
        assert size_of(store.contents()) == cleaned.kept_bytes
        if quota is None:
            assert left == referred
        elif size <= quota:
            assert left == stored
        else:
            assert left == referred or cleaned.kept_bytes <= quota
            last = cleaned.removed[-1:]
            assert not last or cleaned.kept_bytes + last[0].size > quota, "no more than needed"


def run(*arguments, code=0):
    return " ".join(call(app, *arguments, code=code).output.split())


def test_the_command_shows_sizes_and_makes_room(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    config = tmp_path / "tiny.yaml"
    config.write_text(yaml.safe_dump({"placement": "line", "output": str(tmp_path / "runs")}))
    output = run(config, code=2)
    assert output == f"{tmp_path}/runs/store: not a store; no sweep has stored results there"
    store = Store(tmp_path / "runs" / "store")
    a, b = saved(store, "a", "b", size=1_000_000)
    store.refer("tiny", [a.key])
    with store.in_use():
        assert run(config, code=2) == f"{store.folder}: in use by a running sweep"
        output = run(config, "--dry-run")
    assert "would be removed: 1 (1.0 MB); left: 1.0 MB" in output
    assert store.has(b)
    run(store.folder, "--quota", "10MB")
    assert store.has(b)
    output = run(store.folder, "--quota", "1MB", code=1)
    assert "removed: 1 (1.0 MB); left: 1.0 MB" in output
    assert "what sweeps refer to is larger than 1.0 MB" in output
    assert store.finished([a, b]) == {a.key}
    output = run(config, "--forget", "tiny", "--forget", "other", code=2)
    assert output == f"--forget: no sweep 'other' in {store.folder}; found tiny"
    assert store.references() == {"tiny": {a.key}}, "all or none"
    run(config, "--forget", "tiny")
    assert not store.has(a)


def test_the_command_at_a_url_has_to_be_told_that_no_sweep_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store = RemoteStore(tmp_path / "cache", f"memory://{uuid.uuid4().hex}")
    (a,) = saved(store, "a")
    assert "--unlocked" in run(store.url, code=2)
    output = run(store.url, "--dry-run")
    assert "would be removed: 1 " in output
    assert store.has(a)
    run(store.url, "--unlocked")
    assert not store.has(a)


def test_what_is_not_a_store_is_left_alone(tmp_path):
    folder = tmp_path / "photos" / "summer"
    folder.mkdir(parents=True)
    assert "not a store" in run(tmp_path, code=2)
    Store(tmp_path).refer("one", [])
    run(tmp_path)
    assert folder.is_dir()
