"""Arguments and options that commands on a box log share, with values for a shell to complete."""

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.clouds.profiles import PROFILES
from lidarplace.logs.boxes import CLASSES
from lidarplace.rigs.placement import PAPER_PLACEMENTS


def paper_placements() -> list[str]:
    """The paper's placements."""
    return list(PAPER_PLACEMENTS)


def classes() -> list[str]:
    """The classes of objects."""
    return list(CLASSES)


def splits() -> list[str]:
    """The splits of a box log."""
    return ["train", "test"]


LogArgument = Annotated[Path, typer.Argument(help="folder of boxes.parquet and frames.parquet")]

ProfileOption = Annotated[
    str,
    typer.Option(
        metavar="|".join(PROFILES),
        help="LiDAR and way to collect",
        autocompletion=lambda: list(PROFILES),
    ),
]
