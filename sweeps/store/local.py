"""Results on disk, each in a folder named by the hash of what determines it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import naming, sync, temporary, unique, write_text
from lidarplace.files.regular import regular
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task
from sweeps.store import result_folder as results
from sweeps.store.entries import SWEEPS, Entry, entry_of, keys_in
from sweeps.store.lock import locked
from sweeps.store.result_folder import DamagedResult, R, Ran, Record, T
from sweeps.store.whole import whole_folder


@dataclass(frozen=True)
class Note:
    """What is noted of a task that runs: machine and process, when it began, as a person reads it,
    and how much of a training is done."""

    node: str = ""
    pid: int = 0
    since: str = ""
    progress: str = ""


@dataclass(frozen=True)
class Store:
    """A folder of results: `STAGE/KEY/`, and hidden next to them what belongs to running tasks. A
    result is written under a temporary name and renamed, so what is there is whole."""

    folder: Path

    @property
    def shown(self) -> str:
        return str(self.folder)

    def path(self, task: Task) -> Path:
        return self.folder / task.stage.name / task.key

    def finished(self, tasks: Iterable[Task]) -> set[str]:
        return {task.key for task in self._with(lambda task: task.key, tasks)}

    def has(self, task: Task) -> bool:
        return self.path(task).is_dir()

    def save(self, task: Task[Stage[R]], value: R, seconds: float, ran: Ran = Ran()) -> None:
        """Write a result and the seconds that it took. One that is there already stays. Raises
        OSError: it cannot be written, nothing of it is left; TypeError as `write_result`."""
        with self.incoming(task) as folder:
            record = Record(label=task.label, seconds=seconds, **asdict(ran))
            results.write_result(folder, value, f"{task.stage.name}/{task.key}", record)

    def load(self, task: Task[Stage[R]]) -> R:
        """Read a result. Large arrays are mapped, read-only. Raises FileNotFoundError: there is
        none; KeyError: it lacks a field; DamagedResult: it is not what was written, and is
        removed."""
        return self.read(task, results.whole(task.stage.result()))

    def read(self, task: Task[Stage[R]], of: Callable[[R], T]) -> T:
        """What `of` takes from a result, of which no other fields are read; raises as `load`."""
        folder = self.path(task)
        with _removed_if_damaged(folder):
            found = results.read_result(folder, task.stage.result(), of)
        with suppress(OSError):  # a disk may be read-only; the time is for cleaning alone
            os.utime(folder)
        return found

    def record(self, task: Task) -> Record:
        """How the result was computed. Raises FileNotFoundError, DamagedResult as `load`."""
        folder = self.path(task)
        with _removed_if_damaged(folder):
            return results.read_content(folder).record

    def incoming(self, task: Task) -> AbstractContextManager[Path]:
        """An empty folder that becomes the task's result, unless that is there by then."""
        return whole_folder(self.path(task))

    @contextmanager
    def working_folder(self, task: Task) -> Iterator[Path]:
        """A new folder for a task's checkpoints, with the state that any attempt wrote last. What
        the block leaves there, a file that is replaced in one step, is kept until `discard`."""
        folder = self.attempts(task)
        # Hidden are those that a killed process was filling.
        states = [path for attempt in folder.glob("[!.]*") for path in attempt.glob("[!.]*")]
        own = folder / unique()
        with whole_folder(own) as partial:
            if states:
                last = max(states, key=lambda path: path.stat().st_mtime_ns)
                sync(Path(shutil.copy2(last, partial / last.name)))
        yield own

    def attempts(self, task: Task) -> Path:
        """Folder of the attempts at an unfinished task. Two can overlap: two drivers, or a machine
        that was believed dead. In one folder the slower would put its older state under the other's
        feet, so each has its own."""
        return self._hidden(task, "working")

    def discard(self, task: Task) -> None:
        """Remove the checkpoints and the note of a task whose result is there."""
        _remove(self.attempts(task))
        self.note(task).unlink(missing_ok=True)

    @contextmanager
    def running(self, task: Task, note: Note) -> Iterator[Callable[[str], None]]:
        """Leave a note while the block runs, which gets a function for its progress; the note
        stays if the process is killed."""
        path = self.note(task)
        path.parent.mkdir(parents=True, exist_ok=True)

        def write(progress: str = "") -> None:
            partial = temporary(path)  # as `write_text`, but a note need not outlast the machine
            with naming(path):
                text = json.dumps(asdict(replace(note, progress=progress)))
                partial.write_text(text, encoding="utf-8")
                partial.replace(path)

        write()
        try:
            yield write
        finally:
            path.unlink(missing_ok=True)

    def note(self, task: Task) -> Path:
        return self._hidden(task, "running")

    def running_notes(self, tasks: Iterable[Task]) -> dict[str, Note]:
        """Notes by key, also those of killed processes. One that is not whole is left out."""
        notes = {}
        for task in self._noted(tasks):
            # It has ended since, or its machine lost power before the note was on the disk.
            with suppress(FileNotFoundError, ValueError):
                notes[task.key] = Note(**json.loads(self._read(self._note_place(task))))
        return notes

    def end_running(self, tasks: Iterable[Task]) -> None:
        """Remove the notes of tasks: what a killed process left."""
        for task in self._noted(tasks):
            self._remove_file(self._note_place(task))

    def refer(self, name: str, keys: Collection[str]) -> None:
        """Note what the sweep `name` refers to, in place of what it referred to before."""
        path = self.sweep_file(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(sorted(keys)))

    def sweep_file(self, name: str) -> Path:
        return self.folder / SWEEPS / f"{name}.json"

    def references(self) -> dict[str, set[str]]:
        """Keys that each sweep refers to. Raises ValueError that names a damaged file."""
        places = {name: f"{SWEEPS}/{name}.json" for name in self._sweeps()}
        return {
            name: keys_in(self._read(place), f"{self.shown}/{place}")
            for name, place in places.items()
        }

    def forget(self, *names: str) -> None:
        """Refer to nothing in the names of sweeps. Raises ValueError, before, if one is unknown."""
        known = self._sweeps()
        for name in names:
            if name not in known:
                problem, there = f"no sweep {name!r} in {self.shown}", ", ".join(known) or "none"
                raise InputError(problem, place="--forget", found=there)
        for name in names:
            self._remove_file(f"{SWEEPS}/{name}.json")

    def contents(self) -> list[Entry]:
        """All that lies in the folders of the stages, with sizes; nothing that is not a store's."""
        return [
            replace(entry, size=_size(path))
            for stage in sorted(self.folder.glob("[!.]*/"))
            for path in sorted(stage.iterdir())
            if (entry := entry_of(stage.name, path.name))
        ]

    def last_used(self, entry: Entry) -> float:
        """When a result was last loaded or stored, in seconds of this machine's clock."""
        return (self.folder / entry.stage / entry.name).stat().st_mtime

    def remove(self, entry: Entry) -> None:
        """Remove an entry, in one step for who looks for it."""
        _remove(self.folder / entry.stage / entry.name)

    def in_use(self) -> AbstractContextManager[None]:
        """Keep cleaning away while the block runs; drivers may be many."""
        return locked(self.folder, alone=False)

    def exclusive(self) -> AbstractContextManager[None]:
        """Keep drivers away while the block runs. Raises ValueError while there is one."""
        return locked(self.folder, alone=True)

    def _hidden(self, task: Task, kind: str) -> Path:
        return self.folder / task.stage.name / f".{task.key}.{kind}"

    def _note_place(self, task: Task) -> str:
        return f"{task.stage.name}/{self.note(task).name}"

    def _noted(self, tasks: Iterable[Task]) -> Iterator[Task]:
        return self._with(lambda task: self.note(task).name, tasks)

    def _with(self, name: Callable[[Task], str], tasks: Iterable[Task]) -> Iterator[Task]:
        """Tasks of which a name is in the stage's folder: one listing, however many tasks."""
        there: dict[str, Collection[str]] = {}
        for task in tasks:
            if task.stage.name not in there:
                there[task.stage.name] = self._names(task.stage.name)
            if name(task) in there[task.stage.name]:
                yield task

    def _names(self, stage: str) -> Collection[str]:
        with suppress(FileNotFoundError):
            return set(os.listdir(self.folder / stage))
        return ()

    def _sweeps(self) -> list[str]:
        return sorted(path.stem for path in (self.folder / SWEEPS).glob("*.json"))

    def _read(self, place: str) -> bytes:
        return regular(self.folder / place).read_bytes()

    def _remove_file(self, place: str) -> None:
        (self.folder / place).unlink(missing_ok=True)


@contextmanager
def _removed_if_damaged(folder: Path) -> Iterator[None]:
    """Remove a result in which the block finds a damage, which goes on from there."""
    try:
        yield
    except DamagedResult as error:
        try:
            _remove(folder)
        except OSError as why:
            raise OSError(why.errno, f"{error}, but: {why.strerror}") from None
        raise


def _remove(path: Path) -> None:
    """Rename a folder or file away, then remove it: nobody finds half of it under its name."""
    away = path if path.suffix == ".part" else temporary(path)
    try:
        path.rename(away)
    except FileNotFoundError:
        return
    if away.is_dir():
        shutil.rmtree(away)
    else:
        away.unlink()


def _size(path: Path) -> int:
    """Bytes of a file, or of all files under a folder. What goes meanwhile counts nothing."""
    if path.is_dir():
        found = os.walk(path)
        return sum(_size(Path(folder, name)) for folder, _, names in found for name in names)
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
