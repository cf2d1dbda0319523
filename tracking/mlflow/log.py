"""A sweep in MLflow: one experiment, a parent run, and a child run for every trial."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np
import pandas as pd

from lidarplace.files.secret_urls import hide_secrets, public_url
from tracking.mlflow.delivery import Away, Delivery
from tracking.mlflow.journal import (
    ArtifactEntry,
    Dataset,
    Deliverable,
    Journal,
    ModelEntry,
    RefusedEntry,
    SampleEntry,
    StatusEntry,
    SweepEntry,
    TrialEntry,
)
from tracking.mlflow.runs import SweepRuns
from tracking.mlflow.uri import absolute_uri, sqlite_file, ui_command

__all__ = ["SweepLog", "trial_metrics", "ui_command"]

_AFTER_CTRL_C_S = 3.0


class SweepLog:
    """Writes a sweep to MLflow. Only one process may do so at a time: the driver.

    Every entry is in the journal, a file, before a thread sends it. So a server that goes away
    does not hold up the sweep, and a driver killed at any moment loses and doubles nothing: the
    next one sends what has not arrived first. Once all has arrived the journal is removed.

    The parent run and the trials are found again by tags. A resumed sweep continues its parent
    run; a trial that is finished is left alone; one that was cut half way, or failed, continues in
    its run, and what was logged of it is not logged again.

        with SweepLog(uri, "demo", key, params, journal=folder / "mlflow.jsonl") as log:
            log.trial("3f2a", "line · pointpillars_tiny · seed 1", params, metrics, curve)
            log.artifact(run / "report.html")

    The parent is RUNNING in the `with` block. At its end the parent is FINISHED; FAILED after an
    exception, KILLED after Ctrl-C.

    Args:
        uri: MLflow's tracking URI. For `sqlite:///FILE` the folder is made, and artifacts go to
            `artifacts` beside the file; for other databases beside the journal.
        name: of the experiment and of the parent run.
        sweep_key: tells this sweep from others of the experiment; the same when it is resumed.
        params: of the parent run.
        journal: the file of the journal.
        tags: of every run.
        note: what the parent run's page tells, Markdown.
        about: what the experiment's page tells, Markdown.
        columns: what the experiment's page shows of every run, by MLflow's names, such as
            "metrics.seconds"; the first orders the runs.
        ascending: whether the lowest of the first column is on top, else the highest.
        say: prints a line for the user; called from another thread too.
        patience_s: how long the end of the `with` block waits while nothing can be delivered.

    Raises:
        ValueError: the URI cannot hold runs, `sweep_key` has odd characters, or `journal` is no
            journal. From the `with` statement: the server is there, but the experiment was
            deleted, or a parameter is not what it was when the sweep began.
    """

    def __init__(
        self,
        uri: str,
        name: str,
        sweep_key: str,
        params: Mapping[str, object],
        *,
        journal: Path,
        tags: Mapping[str, str] | None = None,
        note: str = "",
        about: str = "",
        columns: Sequence[str] = (),
        ascending: bool = False,
        say: Callable[[str], None] = print,
        patience_s: float = 60.0,
    ) -> None:
        if not re.fullmatch(r"[\w.-]+", sweep_key):  # MLflow's filters know no escape
            raise ValueError(
                f"sweep_key may have letters, digits, '_', '-' and '.', found {sweep_key!r}"
            )
        self.refused = 0
        """Entries that MLflow does not take."""
        self._uri = absolute_uri(uri)
        self._sweep = SweepEntry(
            sweep=sweep_key,
            name=name,
            params=_texts(params),
            tags=dict(tags or {}),
            note=hide_secrets(note, uri),
            about=about,
            columns=tuple(columns),
            ascending=ascending,
        )
        self._print = say
        self._patience_s = patience_s
        self._journal = Journal(journal)
        self._delivery: Delivery[Deliverable] = Delivery(
            self._send, self._refuse, self._away, self._back
        )
        self._runs: dict[str, SweepRuns] = {}
        self._settled: set[str] = set()

    @property
    def undelivered(self) -> int:
        """Entries that are in the journal only."""
        return len(self._delivery)

    def __enter__(self) -> SweepLog:
        database = sqlite_file(self._uri)
        if database is not None:
            try:
                database.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ValueError(f"{self._uri}: {error.strerror}") from error
        place = (database or self._journal.path).parent / "artifacts"
        own = self._runs[self._sweep.sweep] = SweepRuns(self._uri, self._sweep, place)
        away = None
        try:
            own.open()
        except Away as error:
            away = error
        except ValueError as error:
            raise ValueError(hide_secrets(str(error), self._uri)) from None
        self._settled = set(own.finished)
        for entry in self._journal.entries:
            if isinstance(entry, SweepEntry):
                # An earlier configuration of this sweep may have left entries too.
                if entry.sweep != self._sweep.sweep:
                    self._runs[entry.sweep] = SweepRuns(self._uri, entry, place)
            elif not isinstance(entry, RefusedEntry):
                self._put_again(entry)
        self._journal.append(self._sweep)
        self._log(StatusEntry(sweep=self._sweep.sweep, status="RUNNING"))
        self._delivery.start(away)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        status, patience_s = "FINISHED", self._patience_s
        if kind is not None:
            status = "FAILED"
            if issubclass(kind, KeyboardInterrupt):
                status, patience_s = "KILLED", min(patience_s, _AFTER_CTRL_C_S)
        self._log(StatusEntry(sweep=self._sweep.sweep, status=status))
        try:
            self._delivery.finish(patience_s)
        finally:
            if self.undelivered:
                self._say(
                    f"MLflow: {self.undelivered} entries wait in {self._journal.path}; "
                    "the same command delivers them"
                )
        if not self.undelivered and not self.refused:
            self._journal.discard()

    def trial(
        self,
        key: str,
        run_name: str,
        params: Mapping[str, object],
        metrics: Mapping[str, float],
        curve: pd.DataFrame | None = None,
        error: str | None = None,
        *,
        tags: Mapping[str, object] | None = None,
        datasets: Sequence[Dataset] = (),
        files: Sequence[Path] = (),
    ) -> None:
        """Log one trial as a child run. Returns at once, also if it is finished already.

        Args:
            key: tells the trial from others of the sweep; the same when the sweep is resumed.
            run_name: shown in the UI, such as "line · pointpillars_tiny · seed 1".
            metrics: one value each; those that are not finite are left out. "seconds" is also
                the duration of the run.
            curve: epoch, metric, value; the epoch becomes MLflow's step.
            error: why the trial failed; its run gets the status FAILED. The tag takes the first
                5,000 characters.
            tags: to filter by.
            datasets: what it was trained and tested on.
            files: its artifacts, which must stay until the end of the `with` block.

        Raises:
            OSError: the journal cannot be written.
        """
        if self.is_settled(key):
            return
        self._log(
            TrialEntry(
                sweep=self._sweep.sweep,
                key=key,
                run_name=run_name,
                time=time.time_ns() // 1_000_000,
                seconds=metrics.get("seconds", 0.0),
                params=_texts(params),
                points=_points(metrics, curve),
                error=None if error is None else error[:5000],
                tags=_texts(tags or {}),
                datasets=tuple(datasets),
                files=tuple(str(path.resolve()) for path in files),
            )
        )

    def is_settled(self, key: str) -> bool:
        """Whether a trial is finished in MLflow, or on its way there."""
        return key in self._settled

    def artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file to the artifacts of the parent run, into `folder` of them.

        Returns at once: the file must stay as it is until the end of the `with` block.
        """
        self._log(ArtifactEntry(sweep=self._sweep.sweep, path=str(path.resolve()), folder=folder))

    def sample(self, values: Mapping[str, float]) -> None:
        """Log metrics of this moment to the parent run. Their step is the second of the run."""
        time_ms = time.time_ns() // 1_000_000
        self._log(SampleEntry(sweep=self._sweep.sweep, time=time_ms, values=dict(values)))

    def model(self, trial: str, name: str, folder: Path, params: Mapping[str, object]) -> None:
        """Log the best model of a name, with the run that it is from; an earlier one is not now.

        Args:
            trial: key of the trial, logged before.
            folder: in MLflow's format; must stay until the end of the `with` block.
            params: shown beside it.
        """
        self._log(
            ModelEntry(
                sweep=self._sweep.sweep,
                trial=trial,
                name=name,
                path=str(folder.resolve()),
                params=_texts(params),
            )
        )

    def page(self) -> str:
        """The experiment's page below a server's address; empty while the server was never there.

        Columns and order are those of `columns`.
        """
        return self._runs[self._sweep.sweep].page()

    def _log(self, entry: Deliverable) -> None:
        self._journal.append(entry)
        self._put(entry)

    def _put(self, entry: Deliverable) -> None:
        if (
            isinstance(entry, TrialEntry)
            and entry.sweep == self._sweep.sweep
            and entry.error is None
        ):
            self._settled.add(entry.key)
        for part in _parts(entry):
            self._delivery.put(part)

    def _put_again(self, entry: Deliverable) -> None:
        """Send an entry of an earlier driver, whose files may be gone."""
        paths = [entry.path] if isinstance(entry, (ArtifactEntry, ModelEntry)) else []
        paths += entry.files if isinstance(entry, TrialEntry) else []
        gone = [path for path in paths if not Path(path).exists()]
        for path in gone:
            self._say(f"MLflow: {path} is gone, it is no longer logged")
        if isinstance(entry, TrialEntry):
            there = tuple(path for path in entry.files if path not in gone)
            self._put(entry.model_copy(update={"files": there}))
        elif not gone:
            self._put(entry)

    def _send(self, entry: Deliverable) -> None:
        self._runs[entry.sweep].write(entry)

    def _refuse(self, entry: Deliverable, error: Exception) -> None:
        self.refused += 1
        reason = hide_secrets(" ".join(str(error).split()), self._uri)
        what = entry.run_name if isinstance(entry, TrialEntry) else entry.kind
        self._say(f"MLflow refuses {what!r}, kept in {self._journal.path}: {reason}")
        with suppress(OSError):  # the entry itself is there, this is for the reader only
            self._journal.append(RefusedEntry(entry=entry, reason=reason))

    def _away(self, reason: Away) -> None:
        self._say(
            f"MLflow at {public_url(self._uri)} is away, the sweep goes on, entries wait in "
            f"{self._journal.path}: {reason}"
        )

    def _back(self) -> None:
        self._say(f"MLflow at {public_url(self._uri)} is back")

    def _say(self, line: str) -> None:
        self._print(hide_secrets(line, self._uri))


def trial_metrics(results: pd.DataFrame, surrogates: pd.DataFrame) -> dict[str, float]:
    """Metrics of one trial by their names in MLflow.

    Args:
        results: rows of this trial: `AP_R40_3D.Car.0.70`; may be empty.
        surrogates: rows of its placement at its setting of the further axes:
            `surrogate.s_mig.Car`.
    """
    named = {
        f"{row['metric']}.{row['class']}.{row['iou']:.2f}": float(row["value"])
        for row in results.to_dict("records")
    }
    columns = (surrogates[name].tolist() for name in ("surrogate", "class", "value"))
    return named | {
        f"surrogate.{name}.{object_class}": float(value)
        for name, object_class, value in zip(*columns, strict=True)
    }


def _parts(entry: Deliverable) -> Iterator[Deliverable]:
    """What is delivered for an entry: a trial, and each of its files by itself.

    In the journal they are one line, so that no kill parts them; and a file that is refused does
    not take the trial with it.
    """
    yield entry
    if isinstance(entry, TrialEntry):
        for path in entry.files:
            yield ArtifactEntry(sweep=entry.sweep, path=path, folder=None, trial=entry.key)


def _texts(params: Mapping[str, object]) -> dict[str, str]:
    return {name: str(value) for name, value in params.items()}


def _points(
    metrics: Mapping[str, float], curve: pd.DataFrame | None
) -> tuple[tuple[str, int, float], ...]:
    """(name, step, value) of all finite values."""
    points = [(name, 0, float(value)) for name, value in metrics.items()]
    if curve is not None:
        points += [
            (str(row["metric"]), int(row["epoch"]), float(row["value"]))
            for row in curve.to_dict("records")
        ]
    return tuple(point for point in points if np.isfinite(point[2]))
