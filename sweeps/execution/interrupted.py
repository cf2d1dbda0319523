"""Work that breaks off is not lost: one line says how it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from lidarplace.files.secret_urls import hide_secrets

_GOES_ON = "What is finished is kept; the same command goes on from there."


@contextmanager
def going_on(console: Console) -> Iterator[None]:
    """Leave with exit code 1 if the machine fails the block, such as a disk that is full.

    Ctrl-C leaves with 130.
    """
    from sweeps.execution.backends import BackendLost
    from sweeps.store.result_folder import DamagedResult

    try:
        yield
    except (BackendLost, DamagedResult, OSError) as error:
        console.print(f"\n{hide_secrets(str(error))}. {_GOES_ON}", soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print(f"\nStopped. {_GOES_ON}")
        raise typer.Exit(130) from None
