"""A command of this project that runs beside the studio, in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence

LINES = 6
"""The last ones that a command has printed are kept."""
NICENESS = 10
"""It leaves the processor to the page and to who works at this machine."""


class Command:
    """`python -m MODULE …`, which starts at once.

    Args:
        arguments: the module, and what follows it.
        told: called with it after each line, and at the end, by a thread of its own.

    Attributes:
        cancelled: whether it was asked to end.
    """

    def __init__(
        self, arguments: Sequence[str], told: Callable[[Command], None] = lambda command: None
    ) -> None:
        self.cancelled = False
        self._told = told
        self._lines: deque[str] = deque(maxlen=LINES)
        self._process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C at the studio is told to it once, by `cancel`
        )
        os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)
        self._reader = threading.Thread(target=self._read, daemon=True, name="command")
        self._reader.start()

    @property
    def lines(self) -> tuple[str, ...]:
        """What it has printed last."""
        return tuple(self._lines)

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.poll()

    def cancel(self) -> None:
        """Ask it to end, from which it can go on later; `wait` tells when it has."""
        self.cancelled = True
        self._process.send_signal(signal.SIGTERM)

    def wait(self) -> int:
        """Its exit code, once it has ended and all its lines were read."""
        code = self._process.wait()
        self._reader.join()
        return code

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip():
                self._lines.append(line.rstrip())
                self._told(self)
        self._process.wait()
        self._told(self)
