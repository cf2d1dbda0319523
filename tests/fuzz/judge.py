"""Outcomes of wrong input: done, refused in one line that names the place, or a fault of ours."""

import re
import resource
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from typer.testing import CliRunner

from lidarplace.command_line.terminal import visible

MORE_MEMORY = 3 * 2**30
"""Bytes that a case may take beyond what this process has: wrong numbers ask for terabytes."""

LONGEST_S = 120
"""A case that takes longer hangs."""

LONGEST_LINE = 1000
"""Characters: a message that quotes a whole file is none."""

DONE, REFUSED = "done", "refused"


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    Attributes:
        kind: `DONE`, `REFUSED`, or the name of a fault.
        told: the message, or the traceback.
    """

    kind: str
    told: str = ""

    @property
    def fault(self) -> bool:
        return self.kind not in (DONE, REFUSED)


class Hangs(BaseException):
    """No reader may catch it."""


@contextmanager
def guarded() -> Iterator[None]:
    """Memory and time are limited while the block runs."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = psutil.Process().memory_info().vms + MORE_MEMORY

    def ring(*_: object) -> None:
        raise Hangs

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(LONGEST_S)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def judge_verb(
    app: Any, arguments: Sequence[str], places: Sequence[str], codes: Sequence[int]
) -> Outcome:
    """Run a command line in this process.

    Args:
        places: words of which a message must have one: the file, its folder, the option.
        codes: exit codes of what is no fault, beside 2.
    """
    try:
        with guarded():
            result = CliRunner().invoke(app, list(arguments))
    except Hangs:
        return Outcome("hangs")
    error = result.exception
    if error is not None and not isinstance(error, SystemExit):
        return _uncaught(error)
    if result.exit_code in codes:
        return Outcome(DONE, result.stdout)
    if result.exit_code != 2:
        return Outcome(f"exit code {result.exit_code}", result.output)
    if result.stdout:
        return Outcome("printed before it was refused", result.output)
    # Click's own: how the command is called, and the mistake.
    message = re.sub(r"\AUsage: .*\n(Try .*\n)?\n?", "", result.stderr)
    return _line(message, places)


def judge_reader(read: Callable[[], object], places: Sequence[str]) -> Outcome:
    """Call a function that documents ValueError and OSError."""
    try:
        with guarded():
            read()
    except Hangs:
        return Outcome("hangs")
    except (ValueError, OSError) as error:
        if isinstance(error, OSError) and error.filename and error.strerror:
            return _line(f"{error.filename}: {error.strerror}\n", places)
        return _line(" ".join(str(error).split()) + "\n", places)
    except Exception as error:
        return _uncaught(error)
    return Outcome(DONE)


def _uncaught(error: BaseException) -> Outcome:
    return Outcome(type(error).__name__, "".join(traceback.format_exception(error)))


def _line(message: str, places: Sequence[str]) -> Outcome:
    if message.count("\n") != 1:
        return Outcome("not one line", message)
    if len(message) > LONGEST_LINE:
        return Outcome("a very long line", message)
    if not any(visible(place) in message or place in ascii(message) for place in places):
        return Outcome("names no place", message)
    return Outcome(REFUSED, message.strip())


def inside(path: Path, folder: Path) -> tuple[str, ...]:
    """Words that name a file of `folder` in a message."""
    return path.name, path.stem, str(path.relative_to(folder).parent / path.name)
