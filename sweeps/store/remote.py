"""Results at a URL that fsspec knows (s3://, gs://, az://, …), with a folder of copies here."""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from fsspec import AbstractFileSystem
from fsspec.core import url_to_fs

from lidarplace.base.errors import InputError
from lidarplace.files.secret_urls import public_url
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task
from sweeps.store import result_folder as results
from sweeps.store.checkpoint_mirror import fetch, mirrored
from sweeps.store.entries import SWEEPS, Entry, entry_of
from sweeps.store.local import Note, Store
from sweeps.store.result_folder import RECORD, DamagedResult, R, Ran, Record, T
from sweeps.store.whole import put_whole


@dataclass(frozen=True)
class RemoteStore(Store):
    """A store at a URL, from which results are copied to `folder` before they are read.

    An object store cannot rename, so files of a result are at `STAGE/KEY/ID/`, with an ID for every
    writer, and `STAGE/KEY/result.json` is written last: with it the result exists."""

    url: str

    @property
    def public_name(self) -> str:
        return public_url(self.url)

    def finished(self, tasks: Iterable[Task]) -> set[str]:
        return {task.key for task in self._with(lambda task: f"{task.key}/{RECORD}", tasks)}

    def has(self, task: Task) -> bool:
        """Whether there is a result; a local copy does not count, as others cannot read it."""
        filesystem, root = self._remote()
        return bool(filesystem.exists(f"{root}/{task.stage.name}/{task.key}/{RECORD}"))

    def save(self, task: Task[Stage[R]], value: R, seconds: float, ran: Ran = Ran()) -> None:
        with suppress(FileNotFoundError, DamagedResult):
            # A copy stays only if it is whole.
            super().read(task, results.whole(task.stage.result()))
        super().save(task, value, seconds, ran)
        if self.has(task):
            return
        filesystem, root = self._remote()
        folder, target = self.path(task), f"{root}/{task.stage.name}/{task.key}"
        content = results.read_content(folder)
        if content.files:
            filesystem.put(
                [str(folder / name) for name in content.files],
                [f"{target}/{content.id}/{name}" for name in content.files],
            )
        put_whole(filesystem, folder / RECORD, f"{target}/{RECORD}")

    def read(self, task: Task[Stage[R]], of: Callable[[R], T]) -> T:
        """Copy all files of the result to `folder` first, and read it.

        A damaged copy is replaced once. If that is damaged, too, so is the original."""
        copied = super().has(task)
        try:
            if not copied:
                self._copy_here(task)
            return super().read(task, of)
        except DamagedResult as error:
            if not copied:
                self._remove_result(f"{task.stage.name}/{task.key}")
                raise
            logging.getLogger(__name__).warning("%s from %s", error, self.public_name)
        return self.read(task, of)

    def record(self, task: Task) -> Record:
        with suppress(FileNotFoundError, DamagedResult):
            return super().record(task)
        place = f"{task.stage.name}/{task.key}"
        data = self._read(f"{place}/{RECORD}")
        try:
            return results.parse_content(data, place, f"{self.public_name}/{place}").record
        except DamagedResult:
            self._remove_result(place)
            raise

    @contextmanager
    def working_folder(self, task: Task) -> Iterator[Path]:
        """Return a folder that is copied to the URL every few seconds, for other machines."""
        filesystem, root = self._remote()
        attempts = self.attempts(task)
        place = f"{root}/{task.stage.name}/{attempts.name}"
        fetch(filesystem, place, attempts)
        with super().working_folder(task) as folder, mirrored(folder, filesystem, place):
            yield folder

    def discard(self, task: Task) -> None:
        super().discard(task)
        if task.stage.resumable:
            self._remove(f"{task.stage.name}/{self.attempts(task).name}")
        self._remove_file(self._note_place(task))

    @contextmanager
    def running(self, task: Task, note: Note) -> Iterator[Callable[[str], None]]:
        with super().running(task, note) as write_here:

            def write(progress: str = "") -> None:
                write_here(progress)
                self._put(self.note(task), self._note_place(task))

            write()
            try:
                yield write
            finally:
                self._remove_file(self._note_place(task))

    def end_running(self, tasks: Iterable[Task]) -> None:
        tasks = tuple(tasks)
        Store(self.folder).end_running(tasks)
        super().end_running(tasks)

    def refer(self, name: str, keys: Collection[str]) -> None:
        super().refer(name, keys)
        self._put(self.sweep_file(name), f"{SWEEPS}/{name}.json")

    def forget(self, *names: str) -> None:
        super().forget(*names)
        for name in names:
            self.sweep_file(name).unlink(missing_ok=True)

    def contents(self) -> list[Entry]:
        sizes: dict[tuple[str, str], int] = {}
        files = self.find("")
        for path, size in files.items():
            stage, _, rest = path.partition("/")
            place = stage, rest.partition("/")[0]
            sizes[place] = sizes.get(place, 0) + size
        entries = []
        for place, size in sorted(sizes.items()):
            if entry := entry_of(*place):
                whole = entry.kind != "result" or f"{'/'.join(place)}/{RECORD}" in files
                entry = replace(entry, size=size)
                entries.append(entry if whole else replace(entry, kind="partial"))
        return entries

    def last_used(self, entry: Entry) -> float:
        """Return when a result was stored, in seconds of the remote clock."""
        filesystem, root = self._remote()
        modified = filesystem.modified(f"{root}/{entry.stage}/{entry.name}/{RECORD}")
        return float(modified.timestamp())

    def remove(self, entry: Entry) -> None:
        place = f"{entry.stage}/{entry.name}"
        if entry.kind == "result":
            self._remove_result(place)
        else:
            self._remove(place)

    def exclusive(self) -> AbstractContextManager[None]:
        """Raise InputError: sweeps on other machines cannot be seen."""
        problem, fix = "has no lock, so a sweep may be using it", "if none does, add --unlocked"
        raise InputError(problem, place=self.public_name, fix=fix)

    def _remote(self) -> tuple[AbstractFileSystem, str]:
        """Return the filesystem and the path of the store; fsspec has one for each thread."""
        filesystem, root = url_to_fs(self.url)
        filesystem.invalidate_cache()  # other machines write too
        return filesystem, root.rstrip("/")

    def find(self, place: str) -> dict[str, int]:
        """Return the sizes of all files below a place, by relative path, with one listing."""
        filesystem, root = self._remote()
        prefix = f"{root}/{place}".rstrip("/") + "/"
        files = filesystem.find(prefix, detail=True)
        return {path.removeprefix(prefix): int(info["size"]) for path, info in files.items()}

    def _sweeps(self) -> list[str]:
        files = self.find(SWEEPS)
        return [path.removesuffix(".json") for path in files if path.endswith(".json")]

    def _names(self, stage: str) -> Collection[str]:
        return self.find(stage)

    def _copy_here(self, task: Task) -> None:
        filesystem, root = self._remote()
        place = f"{task.stage.name}/{task.key}"
        with self.incoming(task) as folder:
            filesystem.get_file(f"{root}/{place}/{RECORD}", str(folder / RECORD))
            data = (folder / RECORD).read_bytes()
            content = results.parse_content(data, place, f"{self.public_name}/{place}")
            files = content.files
            try:
                if files:
                    filesystem.get(
                        [f"{root}/{place}/{content.id}/{name}" for name in files],
                        [str(folder / name) for name in files],
                    )
            except FileNotFoundError:
                raise results.damaged(f"{self.public_name}/{place}", "a file is missing") from None
            # Digests are checked when files are read.
            results.check_files(folder, files, (), f"{self.public_name}/{place}")

    def _put(self, path: Path, place: str) -> None:
        filesystem, root = self._remote()
        put_whole(filesystem, path, f"{root}/{place}")

    def _read(self, place: str) -> bytes:
        filesystem, root = self._remote()
        data: bytes = filesystem.cat_file(f"{root}/{place}")
        return data

    def _remove_file(self, place: str) -> None:
        filesystem, root = self._remote()
        with suppress(FileNotFoundError):
            filesystem.rm_file(f"{root}/{place}")

    def _remove_result(self, place: str) -> None:
        """Remove a result, first its record, without which it does not exist."""
        self._remove_file(f"{place}/{RECORD}")
        self._remove(place)

    def _remove(self, place: str) -> None:
        filesystem, root = self._remote()
        with suppress(FileNotFoundError):
            filesystem.rm(f"{root}/{place}", recursive=True)
