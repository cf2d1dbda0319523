"""Ctrl-C and SIGTERM, by which Slurm and Kubernetes end programs, stop the work of a command."""

from __future__ import annotations

import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_LOOK_S = 1.0


class Terminated(KeyboardInterrupt):
    """SIGTERM has come: it ends what Ctrl-C ends."""


class _Sigterm:
    """Raises Terminated. While it is handled, a second signal must not interrupt the clean-up.

    Python swallows what is raised in `__del__` or in a weakref callback, and a library may swallow
    it anywhere: then nothing refers to the exception. An alarm looks for that and raises it again.
    A second signal after a lost one, and any third, ends the process for certain.
    """

    def __init__(self) -> None:
        self._came = 0
        self._raised: Callable[[], Terminated | None] = lambda: None

    def install(self) -> None:
        signal.signal(signal.SIGTERM, self._on_signal)
        signal.signal(signal.SIGALRM, self._on_alarm)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._came += 1
        if self._came == 1:
            signal.setitimer(signal.ITIMER_REAL, _LOOK_S, _LOOK_S)
            raise self._new()
        if self._raised() is None or self._came > 2:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.raise_signal(signal.SIGTERM)

    def _on_alarm(self, number: int, frame: FrameType | None) -> None:
        if self._raised() is None:
            raise self._new()

    def _new(self) -> Terminated:
        """An exception that no frame of its traceback refers to."""
        stop = Terminated()
        self._raised = weakref.ref(stop)
        return stop


_sigterm: _Sigterm | None = None


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """SIGTERM raises Terminated and Ctrl-C KeyboardInterrupt in the block, in the main thread.

    Within such a block another one takes the signals back from a library with its own handlers.
    """
    global _sigterm
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if _sigterm is not None:
        _sigterm.install()
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGALRM)}
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:  # while modules were imported
        signal.signal(signal.SIGINT, signal.default_int_handler)
    _sigterm = _Sigterm()
    _sigterm.install()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        _sigterm = None
        for number, handler in before.items():
            signal.signal(number, handler)


def exit_code_of(stop: KeyboardInterrupt) -> int:
    """As a shell tells which signal has ended a program."""
    return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)
