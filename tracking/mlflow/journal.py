"""The journal of a sweep's log: what may not have arrived at the tracking server yet."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from threading import Lock
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from lidarplace.files.atomic import naming


class _Line(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SweepEntry(_Line):
    """A driver began to log a sweep."""

    kind: Literal["sweep"] = "sweep"
    sweep: str
    """Its key."""
    name: str
    """Of the experiment and of the parent run."""
    params: dict[str, str]
    tags: dict[str, str] = {}
    """Of every run: where the code is from, who runs it."""
    note: str = ""
    """Of the parent run, Markdown."""
    about: str = ""
    """Of the experiment, Markdown."""
    columns: tuple[str, ...] = ()
    """What the table of runs shows, by MLflow's names of columns; the first orders it."""
    ascending: bool = False
    """Whether the lowest of the first column is on top."""


class Dataset(_Line):
    """Data that a trial was trained or tested on: a name for it, no copy."""

    name: str
    digest: str
    context: Literal["train", "test"]
    source: dict[str, str]
    """Where it comes from."""
    profile: dict[str, int]
    """How much it is."""


class TrialEntry(_Line):
    """A trial ended."""

    kind: Literal["trial"] = "trial"
    sweep: str
    key: str
    run_name: str
    time: int
    """When it ended, milliseconds since 1970."""
    seconds: float = 0.0
    """That it took."""
    params: dict[str, str]
    points: tuple[tuple[str, int, float], ...]
    """Metric, step, value."""
    error: str | None
    """Why it failed."""
    tags: dict[str, str] = {}
    datasets: tuple[Dataset, ...] = ()
    files: tuple[str, ...] = ()
    """Paths of its artifacts."""


class ArtifactEntry(_Line):
    """A file belongs to the parent run, or to a trial's."""

    kind: Literal["artifact"] = "artifact"
    sweep: str
    path: str
    folder: str | None
    trial: str | None = None
    """Key of the trial."""


class SampleEntry(_Line):
    """Machine and driver at a moment."""

    kind: Literal["sample"] = "sample"
    sweep: str
    time: int
    """Milliseconds since 1970."""
    values: dict[str, float]


class ModelEntry(_Line):
    """A trial has the best weights of its detector."""

    kind: Literal["model"] = "model"
    sweep: str
    trial: str
    """Key of the trial."""
    name: str
    path: str
    """A folder in MLflow's format of models."""
    params: dict[str, str]


class StatusEntry(_Line):
    """The parent run has a new status, one of MLflow's."""

    kind: Literal["status"] = "status"
    sweep: str
    status: str


Deliverable = TrialEntry | ArtifactEntry | SampleEntry | ModelEntry | StatusEntry


class RefusedEntry(_Line):
    """The server does not take an entry. For the reader: the next driver tries again."""

    kind: Literal["refused"] = "refused"
    entry: Deliverable
    reason: str


Entry = SweepEntry | Deliverable | RefusedEntry
_entry: TypeAdapter[Entry] = TypeAdapter(Annotated[Entry, Field(discriminator="kind")])


class Journal:
    """Entries in a file of JSON lines, each on the disk before `append` returns.

    A last line that a killed driver left without its end is cut off when the journal is opened.
    Only one process may have it open at a time; its threads may share it.

    Raises:
        ValueError: a line of the file is no entry.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = Lock()
        lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()
        self._end = sum(map(len, lines))
        self.entries = [self._read(number, line) for number, line in enumerate(lines, 1)]
        """What the file held when it was opened."""

    def append(self, entry: Entry) -> None:
        """Write an entry. After an OSError (a full disk) the file is as it was."""
        line = _entry.dump_json(entry) + b"\n"
        with self._lock:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with naming(self.path), self.path.open("ab", buffering=0) as file:
                file.truncate(self._end)  # what an earlier failure or a killed driver left
                if file.write(line) < len(line):
                    raise OSError(errno.ENOSPC, "half a line is written")
                os.fsync(file.fileno())
            self._end += len(line)

    def discard(self) -> None:
        """Remove the file: everything has arrived."""
        with self._lock:
            self.path.unlink(missing_ok=True)
            self._end = 0

    def _read(self, number: int, line: bytes) -> Entry:
        try:
            return _entry.validate_json(line)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise ValueError(
                f"{self.path}, line {number} is no entry of the journal: {place} {first['msg']}"
            ) from None
