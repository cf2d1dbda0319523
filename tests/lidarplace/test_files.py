"""Files that appear in one step: what is in the way stays, what a killed process left goes."""

import os
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from lidarplace.files.atomic import remove_leftovers, replacing, temporary
from tests.fuzz.mutate_bytes import NO_FILES

ROOT = Path(__file__).parents[2]


def test_a_file_is_replaced_at_the_end_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with suppress(KeyError), replacing(path) as partial:
        partial.write_text("half of the ne")
        raise KeyError
    assert path.read_text() == "old"
    with replacing(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_with_the_same_process_id_do_not_meet(tmp_path, monkeypatch):
    monkeypatch.setattr("os.getpid", lambda: 1)  # as on two hosts, or in two containers
    path = tmp_path / "a.txt"
    with replacing(path) as one, replacing(path) as other:
        one.write_text("one")
        other.write_text("other")
    assert path.read_text() == "one", "the outer one ends last"
    monkeypatch.setattr("socket.gethostname", lambda: "node7")
    assert temporary(path).name.startswith(".a.txt.node7-1-")


@pytest.mark.parametrize("what", ["a FIFO", "a socket", "an empty device", "the device itself"])
def test_a_device_is_not_replaced(tmp_path, what):
    path = tmp_path / "any" if what in NO_FILES else Path("/dev/null")
    NO_FILES.get(what, str)(path)
    before = path.lstat().st_mode
    beside = set(path.parent.glob(".*.part"))
    with pytest.raises(OSError, match="is a device, a pipe or a socket"), replacing(path) as part:
        part.write_text("text")
    assert path.lstat().st_mode == before
    assert not stat.S_ISREG(before)
    assert set(path.parent.glob(".*.part")) == beside


def test_files_and_links_to_files_are_replaced(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "old")
    for name in ("old", "link", "new"):
        with replacing(tmp_path / name) as partial:
            partial.write_text("new")
        assert (tmp_path / name).read_text() == "new"


LEAVE = """
import os, signal, sys
from pathlib import Path
from lidarplace.files.atomic import replacing, temporary
folder = Path(sys.argv[1])
partial = temporary(folder / "a.db")
Path(f"{partial}-journal").write_text("x")
inner = temporary(folder / "models" / "key")
inner.mkdir(parents=True)
(inner / "MLmodel").write_text("x")
with replacing(folder / "table.parquet") as partial:
    partial.write_text("x")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_was_writing_is_removed_and_nothing_else(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", LEAVE, str(tmp_path)], env=environment, check=False)
    assert len([path for path in tmp_path.rglob("*.part*") if path.name[0] == "."]) == 3
    running = temporary(tmp_path / "mine")
    elsewhere = tmp_path / ".a.db.otherhost-1-0123abcd.part"
    others = [tmp_path / name for name in (".hidden.part", "song.part", ".a.x-1-0123abcd.part.txt")]
    kept = [running, elsewhere, *others]
    for path in kept:
        path.write_text("x")
    remove_leftovers(tmp_path)
    assert (tmp_path / "models").is_dir()
    assert any((tmp_path / "models").iterdir())
    remove_leftovers(tmp_path, "**/.*.part*")
    assert sorted(tmp_path.rglob("*")) == sorted([*kept, tmp_path / "models"])
    remove_leftovers(tmp_path / "none")
