"""Log of a sweep to MLflow in the background, however often MLflow goes away."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Condition, Event, Lock, Thread
from typing import TypeVar

from lidarplace.base.errors import InputError
from lidarplace.files.secret_urls import hide_secrets, public_url
from tracking.mlflow.connection import Away
from tracking.mlflow.content import EndedTrial, ParentRun
from tracking.mlflow.runs import SweepRuns
from tracking.mlflow.uri import absolute_uri, sqlite_file

T = TypeVar("T")

LOOK_S = 2.0  # from one look at what has ended to the next
FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 10.0  # between attempts while MLflow is away
_OPENS_WITHIN_S = 60.0
_AFTER_CTRL_C_S = 3.0


class SweepLog:
    """Writer of a sweep's results to MLflow; only one process may write at a time: the driver.

    A thread compares the trials that have ended with the runs at MLflow, now and then and at the
    end, and writes what is missing. So a server that goes away does not hold up the sweep, and a
    driver killed at any moment loses and doubles nothing: the next one finds what is missing.

        with SweepLog(uri, ParentRun(key, "demo", params), folder=folder) as log:
            log.follow(lambda: [EndedTrial("3f2a", describe)])
            log.artifact(run / "report.html")

    The parent is RUNNING in the `with` block, then FINISHED; FAILED after an exception, KILLED
    after Ctrl-C. Artifacts go to `artifacts` next to the file of a `uri` of `sqlite:///FILE`,
    whose folder is made; for other databases to `artifacts` in `folder`. `say` prints a line for
    the user, from another thread too; `patience_s` is how long the end of the block waits in
    vain.

    Raises ValueError: the URI cannot hold runs. From the `with` statement: the experiment was
    deleted, or a parameter is not what it was when the sweep began. From its end: see `hold`."""

    def __init__(
        self,
        uri: str,
        parent: ParentRun,
        *,
        folder: Path,
        say: Callable[[str], None] = print,
        patience_s: float = 60.0,
    ) -> None:
        self._uri = absolute_uri(uri)
        self._database = sqlite_file(self._uri)
        artifacts = (self._database.parent if self._database else folder) / "artifacts"
        without_secrets = replace(parent, note=hide_secrets(parent.note, uri))
        self._runs = SweepRuns(self._uri, without_secrets, artifacts)
        self._print = say
        self._patience_s = patience_s
        self._trials: Callable[[], Iterable[EndedTrial]] = tuple
        self._files: dict[tuple[object, ...], Callable[[], None]] = {}
        self._refused: set[object] = set()
        self._reading = Lock()
        self._held = False
        self._broken: Exception | None = None
        self._mistake: ValueError | None = None
        self._tried = Event()
        self._changed = Condition()
        self._status: str | None = None
        self._delivered = False
        self._stopped = False
        self._is_away = False
        self._thread = Thread(target=self._work, name="MLflow", daemon=True)

    @property
    def refused(self) -> int:
        """Number of runs and files that MLflow does not take."""
        return len(self._refused)

    @property
    def undelivered(self) -> int:
        """Number of runs and files that MLflow neither has nor refuses."""
        trials = sum(map(self._lacks, self._ended()))
        return trials + len(self._files) + (self._status is not None and not self._delivered)

    def __enter__(self) -> SweepLog:
        if self._database is not None:
            try:
                self._database.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{error.strerror}", place=self._uri) from error
        self._thread.start()
        if not self._tried.wait(_OPENS_WITHIN_S):
            self._tried.set()
            self._went_away(f"no answer for {_OPENS_WITHIN_S:g} s")
        if self._mistake is not None:
            raise ValueError(hide_secrets(str(self._mistake), self._uri))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        status, patience_s = "FINISHED", self._patience_s
        if kind is not None or self._broken is not None:
            status = "FAILED"
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            status, patience_s = "KILLED", min(patience_s, _AFTER_CTRL_C_S)
        self._held = False
        with self._changed:
            self._status = status
            self._changed.notify_all()
            while not self._delivered and self._changed.wait(patience_s):
                pass
            self._stopped = True
            self._changed.notify_all()
        if left := self.undelivered:
            self._say(f"MLflow has not got {left} runs or files; the same command delivers them")
        if kind is None and self._broken is not None:
            raise self._broken

    def follow(self, trials: Callable[[], Iterable[EndedTrial]]) -> None:
        """Log all that `trials` reports as ended, from now to the end of the block.

        Another thread calls it again and again, and `describe` of what it returns."""
        self._trials = trials

    def hold(self) -> None:
        """Ask for no more trials before the end of the block: their results are read elsewhere.

        Raises what prevented the report of a trial; no more are asked for, and the end of the
        block raises it, too."""
        with self._reading:
            self._held = True
            if self._broken is not None:
                raise self._broken

    def artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file to the artifacts of the parent run, into `folder` of them.

        Returns at once: the file must stay as it is until the end of the `with` block."""
        self._files[path, folder] = partial(self._runs.write_file, path, folder)

    def page(self) -> str:
        """Return the experiment's page below a server's address; empty while it was never there."""
        return self._runs.page()

    def _work(self) -> None:
        """Run the thread: connect, reconcile until the end, pause while MLflow is away."""
        try:
            self._runs.open()
        except (ValueError, Away) as error:
            if isinstance(error, ValueError) and not self._tried.is_set():
                self._mistake = error
                self._tried.set()
                return
            self._went_away(error)
        self._tried.set()
        pause = FIRST_PAUSE_S
        while not self._stopped:
            status = self._status  # first: what was found before the end is seen below
            try:
                self._reconcile()
                if status is not None:
                    self._write("the end", "the end", partial(self._runs.end, status))
            except Away as error:
                self._went_away(error)
                wait, pause = pause, min(2 * pause, LONGEST_PAUSE_S)
            else:
                self._is_back()
                wait, pause = LOOK_S, FIRST_PAUSE_S
                self._delivered = status is not None
            if self._delivered:
                self._tell_progress()
                return
            self._rest(status, wait)

    def _reconcile(self) -> None:
        """Write what is known by now and missing at MLflow."""
        if not self._runs.is_open:
            try:
                self._runs.open()
            except ValueError as error:  # a person may mend it, until then everything waits
                raise Away(str(error)) from error
        for trial in filter(self._lacks, self._ended()):
            if (run := self._told(trial.describe, None)) is not None:
                self._write(trial.key, run.name, partial(self._runs.write_trial, trial, run))
        for key, write in list(self._files.items()):
            self._write(key, str(key[0]), write)
            del self._files[key]

    def _write(self, key: object, name: str, write: Callable[[], None]) -> None:
        if self._stopped:
            raise Away("given up")
        try:
            write()
        except Away:
            raise
        except Exception as error:
            if key not in self._refused:
                reason = " ".join(str(error).split())
                self._say(f"MLflow refuses {name!r}, the same command tries again: {reason}")
            self._refused.add(key)
        self._is_back()
        self._tell_progress()

    def _tell_progress(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def _rest(self, status: str | None, seconds: float) -> None:
        """Wait, until the end at most."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._status != status, seconds)

    def _lacks(self, trial: EndedTrial) -> bool:
        return trial.key not in self._refused and self._runs.lacks(trial)

    def _ended(self) -> list[EndedTrial]:
        return self._told(lambda: list(self._trials()), [])

    def _told(self, tell: Callable[[], T], otherwise: T) -> T:
        """Ask the sweep; return `otherwise` while it must not be asked, and after an error."""
        with self._reading:
            if not self._held and self._broken is None:
                try:
                    return tell()
                except Exception as error:
                    self._broken = error
        return otherwise

    def _went_away(self, why: object) -> None:
        if not self._is_away and not self._stopped:
            self._is_away = True
            self._say(
                f"MLflow at {public_url(self._uri)} is unreachable, the sweep continues: {why}"
            )

    def _is_back(self) -> None:
        if self._is_away:
            self._is_away = False
            self._say(f"MLflow at {public_url(self._uri)} is back")

    def _say(self, line: str) -> None:
        self._print(hide_secrets(line, self._uri))
