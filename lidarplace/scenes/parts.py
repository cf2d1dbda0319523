"""What a scene consists of: parts that are recorded by themselves, and so in parallel."""

from dataclasses import dataclass
from typing import Protocol

from lidarplace.logs.box_log import BoxLog


class Recording(Protocol):
    """All that the log of a part depends on: a frozen dataclass of settings and plain data."""

    def record(self) -> BoxLog:
        """The log, the same whenever it is asked for."""


@dataclass(frozen=True)
class ScenePart:
    """A part of a scene."""

    name: str  # what is added to the scene's label; empty if the scene has one part
    recording: Recording  # gives its log
    splits: tuple[str, ...]  # "train", "test" or both: what its frames are for
