"""Arguments and options that commands on a box log share, with values for a shell to complete."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.profiles import PROFILES

LogArgument = Annotated[Path, typer.Argument(help="folder of boxes.parquet and frames.parquet")]

VehicleOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="body of the vehicle: YAML file with the value of a sweep's key vehicle, or a mesh in "
        "metres; a sedan by default",
    ),
]

ProfileOption = Annotated[
    str,
    typer.Option(
        metavar="|".join(PROFILES),
        help="LiDAR model and collection of the clouds",
        autocompletion=lambda: list(PROFILES),
    ),
]

RoiOption = Annotated[
    tuple[float, float, float, float, float, float],
    typer.Option("--roi", help="x0 x1 y0 y1 z0 z1, ego frame, m"),
]
FRONT_ROI = (0.0, 40.0, -20.0, 20.0, 0.0, 4.0)
"""Half of the paper's region of interest that its experiments use."""


def crop_of(roi: Sequence[float]) -> Crop:
    """Return the region of `--roi`. Raises ValueError if it is empty or endless."""
    x0, x1, y0, y1, z0, z1 = roi
    for axis, low, high in (("x", x0, x1), ("y", y0, y1), ("z", z0, z1)):
        if not -1e4 <= low < high <= 1e4:  # NaN is refused too
            allowed, ends = "min < max within ±10,000 m", f"{low:g} {high:g}"
            raise InputError(place="--roi", key=axis, expected=allowed, found=ends)
    return x0, y0, z0, x1, y1, z1
