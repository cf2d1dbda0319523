"""Calls of plug-ins: the harm that their code does becomes one line that names them."""

import logging
import math
import os
import pkgutil
import reprlib
import sys
import traceback
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from numbers import Real
from threading import Timer
from typing import Any

import numpy as np
from pydantic import ValidationError

from lidarplace.base.errors import InputError
from lidarplace.base.plugin_folders import PLUGINS, Folders, active_folders, current_folder

SLOW_IMPORT_S = 10.0
"""Seconds after which the import of a plug-in is reported as what a command waits for."""

_STREAMS = {"stdout": 1, "stderr": 2}

_harmful: dict[tuple[Folders, str], InputError] = {}
"""Errors of imports that succeeded and did harm, which a second import would not repeat."""

_log = logging.getLogger(__name__)


def plugin_place(error: BaseException) -> str:
    """Return `FILE:LINE: ` of the innermost call of a plug-in in a traceback; "" without one."""
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        package = str(frame.f_globals.get("__name__")).partition(".")[0]
        if package in PLUGINS:
            _, folder, file = frame.f_code.co_filename.rpartition(f"/{package}/")
            place = f"{folder[1:]}{file}:{line}: "
    return place


@contextmanager
def foreign_code(name: str, passed: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Guard a block that calls the plug-in `name`, from which exceptions in `passed` may come.

    Raises InputError at `name`: the block raised another exception, or called `sys.exit`; it closed
    standard output or error; it turned warnings into errors for the whole process."""
    closed, strict = _closed_streams(), _strict_filters()
    cause: BaseException | None = None
    problem = ""
    try:
        with np.errstate(), current_folder():  # what it sets of floating-point errors ends here
            yield
    except MemoryError:
        raise
    except passed:
        raise
    except SystemExit as error:
        if vars(error):  # Ray's, for SIGTERM
            raise
        problem, cause = f"{plugin_place(error)}calls sys.exit({error.code!r})", error
    except Exception as error:
        problem, cause = plugin_place(error) + _reason(error), error
    if streams := _closed_streams() - closed:
        problem = problem or f"closes sys.{' and sys.'.join(sorted(streams))}"
        _reopen(streams)
    if filters := [item for item in _strict_filters() if item not in strict]:
        problem = problem or "turns warnings into errors for the whole process"
        for item in filters:
            with suppress(ValueError):  # another thread did it
                _filters().remove(item)
    if problem:
        raise InputError(problem, place=name) from cause


def import_plugin(path: str, name: str) -> Any:
    """Import `package.module:attribute`. Raises InputError at `name`, as `foreign_code`."""
    text = f"{name}: its import takes more than {SLOW_IMPORT_S:g} s"
    timer = Timer(SLOW_IMPORT_S, _log.warning, (text,))
    timer.daemon = True
    timer.start()
    try:
        if (active_folders(), path) in _harmful:
            raise _harmful[active_folders(), path]
        with foreign_code(name):
            return pkgutil.resolve_name(path)
    except InputError as error:
        if (cause := error.__cause__) is None:
            _harmful[active_folders(), path] = error
        raise InputError(f"cannot be imported: {error.problem}", place=name) from cause
    finally:
        timer.cancel()


def finite_number(value: object, place: str) -> float:
    """Return `value` if it is one finite real number. Raises InputError at `place`."""
    try:
        number = float(value) if isinstance(value, Real) else math.nan
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if not math.isfinite(number):
        expected, text = "one finite real number", reprlib.repr(value)
        raise InputError("wrong value", place=place, expected=expected, found=text)
    return number


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):  # of a field of `Surrogate` or `Metric`
        first = error.errors(include_url=False)[0]
        key, expected = ".".join(map(str, first["loc"])), first["msg"].removeprefix("Input should ")
        value = reprlib.repr(first["input"])
        error = InputError(key=key, expected=expected.removeprefix("be "), found=value)
    kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    return kind + " ".join(str(error).split())


def _closed_streams() -> set[str]:
    """Return names of the standard streams that cannot be written to."""
    return {
        name
        for name, descriptor in _STREAMS.items()
        if getattr(getattr(sys, name), "closed", True) or not _is_open(descriptor)
    }


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def _reopen(streams: Collection[str]) -> None:
    """Open standard streams again, as a file that is opened next would take their place."""
    for name in streams:
        if not _is_open(_STREAMS[name]):
            null = os.open(os.devnull, os.O_WRONLY)
            if null != _STREAMS[name]:
                os.dup2(null, _STREAMS[name])
                os.close(null)
        setattr(sys, name, os.fdopen(_STREAMS[name], "w", closefd=False))


def _filters() -> Any:
    return warnings.filters


def _strict_filters() -> list[Any]:
    """Return filters that turn every warning of a category of Python's into an error."""
    return [
        item
        for item in _filters()
        if item[0] == "error" and item[1] is item[3] is None and item[2].__module__ == "builtins"
    ]
