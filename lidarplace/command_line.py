"""What commands share: options, a console as wide as needed, one line for a mistake."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Annotated, NoReturn, TypeVar

import typer
from rich.console import Console

from lidarplace.lidar.clouds import Crop

T = TypeVar("T")

RoiOption = Annotated[
    tuple[float, float, float, float, float, float],
    typer.Option("--roi", help="x0 x1 y0 y1 z0 z1, ego frame, m"),
]
FRONT_ROI = (0.0, 40.0, -20.0, 20.0, 0.0, 4.0)
"""The half of the paper's region of interest that its experiments use."""


def crop_of(roi: Sequence[float]) -> Crop:
    """The region that `--roi` names. Raises ValueError if it is empty or endless."""
    x0, x1, y0, y1, z0, z1 = roi
    for axis, low, high in (("x", x0, x1), ("y", y0, y1), ("z", z0, z1)):
        if not -1e4 <= low < high <= 1e4:  # NaN is refused too
            raise ValueError(
                f"--roi: {axis} needs min < max within ±10,000 m, found {low:g} {high:g}"
            )
    return x0, y0, z0, x1, y1, z1


def known(option: str, name: str, choices: Mapping[str, T]) -> T:
    """The choice of that name. Raises ValueError that lists the names."""
    if name not in choices:
        raise ValueError(f"--{option} {name}: allowed are {', '.join(choices)}")
    return choices[name]


def wrong(message: object) -> NoReturn:
    """Print what the user has to mend, in one line, and leave with exit code 2."""
    if isinstance(message, OSError) and message.filename and message.strerror:
        message = f"{message.filename}: {message.strerror}"
    print(" ".join(str(message).split()), file=sys.stderr)
    raise typer.Exit(2)


def output() -> Console:
    """Where tables are printed. A log file has no width, for which rich would take 80 columns."""
    return Console() if sys.stdout.isatty() else Console(width=160)
