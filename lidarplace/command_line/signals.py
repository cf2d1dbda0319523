"""Ctrl-C and SIGTERM, by which Slurm and Kubernetes end programs, stop the work of a command."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Terminated(KeyboardInterrupt):
    """SIGTERM has come: it ends what Ctrl-C ends."""


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """SIGTERM raises Terminated and Ctrl-C KeyboardInterrupt in the block, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:  # while modules were imported
        signal.signal(signal.SIGINT, signal.default_int_handler)
    take_sigterm()
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def take_sigterm() -> None:
    """Have SIGTERM raise Terminated again, after a library has put its own handler there."""
    signal.signal(signal.SIGTERM, _raise)


def exit_code_of(stop: KeyboardInterrupt) -> int:
    """As a shell tells which signal has ended a program."""
    return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)


def _raise(number: int, frame: FrameType | None) -> None:
    # One is enough: a second must not break off what tidies up.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise Terminated
