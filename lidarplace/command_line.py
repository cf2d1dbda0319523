"""What all commands do alike: a console as wide as needed, one line for a mistake, exit code 2."""

from __future__ import annotations

import sys
from typing import NoReturn

import typer
from rich.console import Console


def wrong(message: object) -> NoReturn:
    """Print what the user has to mend, in one line, and leave with exit code 2."""
    print(" ".join(str(message).split()), file=sys.stderr)
    raise typer.Exit(2)


def output() -> Console:
    """Where tables are printed. A log file has no width, for which rich would take 80 columns."""
    return Console() if sys.stdout.isatty() else Console(width=160)
