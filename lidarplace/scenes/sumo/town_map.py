"""What traffic drives on: a SUMO network, and how it lies in its town."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class TownMap:
    """A SUMO network of a town.

    Attributes:
        path: its file.
        lefthand: whether vehicles keep left in the network.
        mirrored: whether it is the mirror image, y for -y, of a town in which vehicles keep left.
    """

    path: Path
    lefthand: bool = False
    mirrored: bool = False
