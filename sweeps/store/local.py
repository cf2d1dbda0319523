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
    """A note on a task that runs.

    Machine and process, when it started, and the progress of a training; the last two for people.
    """

    node: str = ""
    pid: int = 0
    since: str = ""
    progress: str = ""


@dataclass(frozen=True)
class Store:
    """A folder of results, `STAGE/KEY/`, with hidden files of running tasks next to them.

    A result is written under a temporary name and renamed, so it is always whole."""

    folder: Path

    @property
    def public_name(self) -> str:
        """The folder, or the URL without secrets."""
        return str(self.folder)

    def path(self, task: Task) -> Path:
        """Return the folder of a result."""
        return self.folder / task.stage.name / task.key

    def finished(self, tasks: Iterable[Task]) -> set[str]:
        """Return the keys of the tasks that have a result."""
        return {task.key for task in self._with(lambda task: task.key, tasks)}

    def has(self, task: Task) -> bool:
        """Whether a task has a result."""
        return self.path(task).is_dir()

    def save(self, task: Task[Stage[R]], value: R, seconds: float, ran: Ran = Ran()) -> None:
        """Write a result and the seconds that it took; an existing one stays.

        Raises OSError: it cannot be written, nothing of it is left; TypeError: see `write_result`.
        """
        with self.incoming(task) as folder:
            record = Record(label=task.label, seconds=seconds, **asdict(ran))
            results.write_result(folder, value, f"{task.stage.name}/{task.key}", record)

    def load(self, task: Task[Stage[R]]) -> R:
        """Read a result; large arrays are mapped, read-only.

        Raises FileNotFoundError: there is none; KeyError: it lacks a field; DamagedResult: it is
        not what was written, and is removed."""
        return self.read(task, results.whole(task.stage.result()))

    def read(self, task: Task[Stage[R]], of: Callable[[R], T]) -> T:
        """Return `of` a result, of which only the fields that it uses are read; see `load`."""
        folder = self.path(task)
        with _removed_if_damaged(folder):
            value = results.read_result(folder, task.stage.result(), of)
        with suppress(OSError):  # a disk may be read-only; the time is for cleaning alone
            os.utime(folder)
        return value

    def record(self, task: Task) -> Record:
        """Return how a result was computed. Raises FileNotFoundError, DamagedResult: see `load`."""
        folder = self.path(task)
        with _removed_if_damaged(folder):
            return results.read_content(folder).record

    def incoming(self, task: Task) -> AbstractContextManager[Path]:
        """Return an empty folder that becomes the result of a task, unless that exists by then."""
        return whole_folder(self.path(task))

    @contextmanager
    def working_folder(self, task: Task) -> Iterator[Path]:
        """Return a new folder for checkpoints of a task, with the last state of any attempt.

        A file that the block leaves there, replaced in one step, stays until `discard`."""
        folder = self.attempts(task)
        # Hidden ones are those that a killed process was filling.
        states = [path for other in folder.glob("[!.]*") for path in other.glob("[!.]*")]
        attempt = folder / unique()
        with whole_folder(attempt) as partial:
            if states:
                last = max(states, key=lambda path: path.stat().st_mtime_ns)
                sync(Path(shutil.copy2(last, partial / last.name)))
        yield attempt

    def attempts(self, task: Task) -> Path:
        """Return the folder of the attempts at an unfinished task.

        Two can overlap: two drivers, or a machine that was believed dead. In one folder the slower
        would overwrite the newer state, so each attempt has a folder."""
        return self._hidden(task, "working")

    def discard(self, task: Task) -> None:
        """Remove the checkpoints and the note of a task that has a result."""
        _remove(self.attempts(task))
        self.note(task).unlink(missing_ok=True)

    @contextmanager
    def running(self, task: Task, note: Note) -> Iterator[Callable[[str], None]]:
        """Keep a note while the block runs, which gets a function for its progress.

        The note stays if the process is killed."""
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
        """Return the file of a note."""
        return self._hidden(task, "running")

    def running_notes(self, tasks: Iterable[Task]) -> dict[str, Note]:
        """Return notes by key, also of killed processes, less those that are not whole."""
        notes = {}
        for task in self._noted(tasks):
            # It has ended since, or its machine lost power before the note was on the disk.
            with suppress(FileNotFoundError, ValueError):
                notes[task.key] = Note(**json.loads(self._read(self._note_place(task))))
        return notes

    def end_running(self, tasks: Iterable[Task]) -> None:
        """Remove the notes of tasks that a killed process left."""
        for task in self._noted(tasks):
            self._remove_file(self._note_place(task))

    def refer(self, name: str, keys: Collection[str]) -> None:
        """Note the results that the sweep `name` refers to, instead of earlier ones."""
        path = self.sweep_file(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(sorted(keys)))

    def sweep_file(self, name: str) -> Path:
        """Return the file of the references of a sweep."""
        return self.folder / SWEEPS / f"{name}.json"

    def references(self) -> dict[str, set[str]]:
        """Return the keys that each sweep refers to. Raises InputError: a file is damaged."""
        places = {name: f"{SWEEPS}/{name}.json" for name in self._sweeps()}
        return {
            name: keys_in(self._read(place), f"{self.public_name}/{place}")
            for name, place in places.items()
        }

    def forget(self, *names: str) -> None:
        """Remove the references of sweeps. Raises InputError, before, if one is unknown."""
        sweeps = self._sweeps()
        for name in names:
            if name not in sweeps:
                problem, listed = (
                    f"no sweep {name!r} in {self.public_name}",
                    ", ".join(sweeps) or "none",
                )
                raise InputError(problem, place="--forget", found=listed)
        for name in names:
            self._remove_file(f"{SWEEPS}/{name}.json")

    def contents(self) -> list[Entry]:
        """List the entries in the folders of stages, with sizes; other files are no entries."""
        return [
            replace(entry, size=_size(path))
            for stage in sorted(self.folder.glob("[!.]*/"))
            for path in sorted(stage.iterdir())
            if (entry := entry_of(stage.name, path.name))
        ]

    def last_used(self, entry: Entry) -> float:
        """Return when a result was last loaded or stored, seconds of this machine's clock."""
        return (self.folder / entry.stage / entry.name).stat().st_mtime

    def remove(self, entry: Entry) -> None:
        """Remove an entry, in one step for readers."""
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
        """Select tasks of which a name is in the folder of the stage, by one listing."""
        names: dict[str, Collection[str]] = {}
        for task in tasks:
            stage = task.stage.name
            if stage not in names:
                names[stage] = self._names(stage)
            if name(task) in names[stage]:
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
    """Remove a result if the block finds it damaged."""
    try:
        yield
    except DamagedResult as error:
        try:
            _remove(folder)
        except OSError as why:
            raise OSError(why.errno, f"{error}, but: {why.strerror}") from None
        raise


def _remove(path: Path) -> None:
    """Rename a folder or file, then remove it: a reader never meets half of it."""
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
    """Return the bytes of a file, or of all files below a folder; removed ones count 0."""
    if path.is_dir():
        folders = os.walk(path)
        return sum(_size(Path(folder, name)) for folder, _, names in folders for name in names)
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
