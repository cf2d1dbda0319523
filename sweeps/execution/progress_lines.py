"""Where things stand, a line now and then: what a log file has in place of a terminal's bars."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rich.console import Console

from sweeps.execution.running import minutes

FIRST_S = 30.0
"""Seconds between two lines, …"""
SHARE = 0.05
"""… or so much of the time that has gone: ten hours are a hundred lines or so."""


class ProgressLines:
    """Prints lines from a thread of its own, as the driver may wait for a training for hours.

    Use as a context manager; does nothing in a terminal.

    Args:
        tell: what a line says after the time.
    """

    def __init__(self, console: Console, tell: Callable[[], str]) -> None:
        self._console = console
        self._tell = tell
        self._start = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="progress lines", daemon=True)

    def __enter__(self) -> ProgressLines:
        if not self._console.is_terminal:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self._start

    def _run(self) -> None:
        while not self._ended.wait(max(FIRST_S, SHARE * self.elapsed)):
            text = f"{minutes(self.elapsed):>7}  {self._tell()}"
            self._console.print(text, soft_wrap=True)
