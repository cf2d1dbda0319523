"""Stop of a command by Ctrl-C or SIGTERM, by which Slurm and Kubernetes end programs."""

import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LOOK_S = 1.0


class Interrupted(KeyboardInterrupt):
    """Ctrl-C has come. Unlike its base it can be referred to weakly."""


class Terminated(KeyboardInterrupt):
    """SIGTERM has come: it ends what Ctrl-C ends."""


_RAISED = {signal.SIGINT: Interrupted, signal.SIGTERM: Terminated}


class _Stop:
    """Raiser of the first signal as an exception, which survives libraries that swallow it.

    A second signal must not interrupt the clean-up. Python swallows what is raised in `__del__` or
    in a weakref callback, and a library may swallow it anywhere: then nothing refers to the
    exception. An alarm looks for that and raises it again. A second signal after one that is lost
    or held, and any third, ends the process for certain."""

    def __init__(self) -> None:
        self.held = False  # whether nothing is raised for now
        self._came: list[int] = []
        self._raised: Callable[[], KeyboardInterrupt | None] = lambda: None

    def install(self) -> None:
        for number in _RAISED:
            if signal.getsignal(number) != signal.SIG_IGN:  # a job in a shell's background
                signal.signal(number, self._on_signal)
        signal.signal(signal.SIGALRM, self.look)

    def look(self, *_: object) -> None:
        """Raise what has come, if no exception of it exists."""
        if self._came and not self.held and self._raised() is None:
            signal.setitimer(signal.ITIMER_REAL, _LOOK_S, _LOOK_S)
            raise self._new()

    def _new(self) -> KeyboardInterrupt:
        """Return an exception to which no frame of its traceback refers."""
        stop = _RAISED[signal.Signals(self._came[0])]()
        self._raised = weakref.ref(stop)
        return stop

    def _on_signal(self, number: int, _: object) -> None:
        self._came.append(number)
        if len(self._came) > 2 or (len(self._came) == 2 and self._raised() is None):
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        self.look()


_stop: _Stop | None = None


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Raise Terminated for SIGTERM and Interrupted for Ctrl-C in the block, in the main thread.

    Within such a block another one takes the signals back from a library with its own handlers."""
    global _stop
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if _stop is not None:
        _stop.install()
        yield
        return
    before = {number: signal.getsignal(number) for number in (*_RAISED, signal.SIGALRM)}
    _stop = _Stop()
    _stop.install()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        _stop = None
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def signals_held() -> Iterator[None]:
    """Raise a first Ctrl-C in the block at its end; a second one ends the process.

    For native code that crashes the process if it is left half-way."""
    stop = _stop if threading.current_thread() is threading.main_thread() else None
    stop = stop or _Stop()
    stop.held = True
    try:
        yield
    finally:
        stop.held = False
        stop.look()


def exit_code_of(stop: KeyboardInterrupt) -> int:
    """Return the exit code of a program that a signal ended."""
    return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)
