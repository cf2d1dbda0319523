"""Work that breaks off is not lost: one line says how it goes on."""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import typer
from rich.console import Console

from lidarplace.command_line.signals import exit_code_of
from lidarplace.command_line.verbs import wrong
from lidarplace.files.secret_urls import hide_secrets

T = TypeVar("T")

_GOES_ON = "What is finished is kept; the same command goes on from there."


def interruptible(console: Console, work: Callable[[], T]) -> T:
    """What `work` returns, which begins again after a damaged result (`sweeps.store.damage`).

    Leaves with exit code 1 if the machine fails it, such as a disk that is full, with 2 if a
    cluster cannot be joined, with 130 at Ctrl-C and 143 at SIGTERM.
    """
    from sweeps.execution.backends import BackendLost
    from sweeps.execution.ray_cluster import ClusterError
    from sweeps.store.damage import until_whole
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
