"""Arguments and options that commands on a box log share, with values for a shell to complete."""

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.clouds.profiles import PROFILES

LogArgument = Annotated[Path, typer.Argument(help="folder of boxes.parquet and frames.parquet")]

ProfileOption = Annotated[
    str,
    typer.Option(
        metavar="|".join(PROFILES),
        help="LiDAR model and collection of the clouds",
        autocompletion=lambda: list(PROFILES),
    ),
]
