"""Work that breaks off: it begins again, or a line says how to resume it."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import typer
from rich.console import Console

from lidarplace.command_line.signals import exit_code_of
from lidarplace.command_line.verbs import wrong
from lidarplace.files.secret_urls import hide_secrets

T = TypeVar("T")

_PATIENCE = 3  # a disk that damages the same result every time is not worth more
_GOES_ON = "Finished work is kept; run the same command to resume."


def interruptible(console: Console, work: Callable[[], T]) -> T:
    """Return the result of `work`, which begins again after a damaged result (`until_whole`).

    Raises typer.Exit: with code 1 if the machine fails, such as a full disk, with 2 if a cluster
    cannot be joined, with 130 at Ctrl-C and 143 at SIGTERM."""
    from sweeps.execution.backends import BackendLost
    from sweeps.execution.ray_cluster import ClusterError
    from sweeps.store.result_folder import DamagedResult

    try:
        return until_whole(work, partial(console.print, soft_wrap=True))
    except ClusterError as error:
        wrong(error)
    except (BackendLost, DamagedResult, OSError) as error:
        console.print(f"\n{hide_secrets(str(error))}. {_GOES_ON}", soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt as stop:
        console.print(f"\nStopped. {_GOES_ON}")
        raise typer.Exit(exit_code_of(stop)) from None


def until_whole(work: Callable[[], T], say: Callable[[str], object]) -> T:
    """Return the result of `work`, which begins again after a `DamagedResult`.

    The store removes a damaged result, so it is computed again. Raises DamagedResult if the same
    result is damaged again and again. `say` prints the line that names it."""
    from sweeps.store.result_folder import DamagedResult

    faults = Counter[str]()
    while True:
        try:
            return work()
        except DamagedResult as error:
            faults[str(error)] += 1
            if faults[str(error)] == _PATIENCE:
                raise
            say(hide_secrets(str(error)))
