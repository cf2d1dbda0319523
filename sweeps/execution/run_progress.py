"""What runs now: bars in a terminal, a line now and then in a log file."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from typing import Self

from rich.console import Console
from rich.progress import Progress, ProgressColumn

from sweeps.execution.running import Running, RunningColumn, minutes
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task

FIRST_S = 30.0
"""Seconds between two lines, …"""
SHARE = 0.05
"""… or so much of the time that has gone: ten hours are a hundred lines or so."""


class RunProgress(ABC):
    """Use as a context manager.

    Lines come from a thread of their own, as the driver may wait for a training for hours.

    Args:
        store: has notes of what runs.
        columns: of a bar, which ends with its field `now`, see `RunningColumn`.
    """

    def __init__(self, console: Console, store: AnyStore, *columns: ProgressColumn) -> None:
        self._console = console
        self._running = Running(store.running_notes)
        self._bars = Progress(
            *columns,
            RunningColumn(),
            console=console,
            expand=True,
            disable=not console.is_terminal,
        )
        self._start = time.monotonic()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="progress lines", daemon=True)

    def __enter__(self) -> Self:
        self._bars.start()
        if self._bars.disable:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        if self._bars.disable:
            self._thread.join()
        self._bars.stop()

    def started(self, task: Task) -> None:
        """As the executor tells a listener."""
        self._running.started(task)

    @abstractmethod
    def now(self) -> str:
        """What a line says after the time."""

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self._start

    def _run(self) -> None:
        while not self._stopped.wait(max(FIRST_S, SHARE * self.elapsed)):
            self._console.print(f"{minutes(self.elapsed):>7}  {self.now()}", soft_wrap=True)
