"""The journal: on the disk before it is sent, whole after a driver was killed."""

from __future__ import annotations

import errno
import os

import pytest

from tracking.mlflow.journal import (
    ArtifactEntry,
    Journal,
    RefusedEntry,
    StatusEntry,
    SweepEntry,
    TrialEntry,
)

SWEEP = SweepEntry(sweep="k1", name="demo", params={"epochs": "3"})
TRIAL = TrialEntry(
    sweep="k1",
    key="t1",
    run_name="line · tiny · seed 1\nand more",
    time=1_700_000_000_000,
    params={"seed": "1"},
    points=(("loss", 1, 0.1 + 0.2), ("AP", 0, 1e-300)),
    error=None,
)
ARTIFACT = ArtifactEntry(sweep="k1", path="/runs/demo/report.html", folder=None)
STATUS = StatusEntry(sweep="k1", status="FINISHED")
REFUSED = RefusedEntry(entry=TRIAL, reason="no such name")
ALL = [SWEEP, TRIAL, ARTIFACT, STATUS, REFUSED]


def written(path):
    journal = Journal(path)
    for entry in ALL:
        journal.append(entry)
    return path


def test_what_is_written_is_read_again(tmp_path):
    path = written(tmp_path / "runs" / "mlflow.jsonl")
    assert Journal(path).entries == ALL
    assert path.read_bytes().count(b"\n") == len(ALL)


@pytest.mark.parametrize("left", [1, 20, -1])
def test_a_torn_last_line_is_ignored_and_overwritten(tmp_path, left):
    path = written(tmp_path / "mlflow.jsonl")
    whole = path.read_bytes()
    last = whole.splitlines(keepends=True)[-1]
    path.write_bytes(whole[: -len(last)] + last[:left])
    journal = Journal(path)
    assert journal.entries == ALL[:-1]
    journal.append(STATUS)
    assert Journal(path).entries == [*ALL[:-1], STATUS]


def test_every_entry_is_on_the_disk_before_append_returns(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_size))
    path = written(tmp_path / "mlflow.jsonl")
    assert len(synced) == len(ALL)
    assert synced[-1] == path.stat().st_size


def test_a_full_disk_leaves_no_half_line_between_entries(tmp_path, monkeypatch):
    path = tmp_path / "mlflow.jsonl"
    journal = Journal(path)
    journal.append(SWEEP)

    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            journal.append(TRIAL)
    journal.append(STATUS)
    assert Journal(path).entries == [SWEEP, STATUS]


def test_an_empty_journal_is_no_file(tmp_path):
    path = tmp_path / "mlflow.jsonl"
    assert Journal(path).entries == []
    assert not path.exists()
    journal = Journal(written(path))
    journal.discard()
    assert not path.exists()
    journal.append(SWEEP)
    assert Journal(path).entries == [SWEEP]


@pytest.mark.parametrize("line", [b'{"kind":"trail"}\n', b"\xff\n", b'{"kind":"status"}\n', b"\n"])
def test_a_line_that_is_no_entry_is_named(tmp_path, line):
    path = written(tmp_path / "mlflow.jsonl")
    first, *rest = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + line + b"".join(rest))
    with pytest.raises(ValueError, match=r"mlflow\.jsonl, line 2 is no entry of the journal: "):
        Journal(path)
