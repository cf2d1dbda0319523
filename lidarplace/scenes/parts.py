"""Parts of a scene, which are recorded by themselves, and so in parallel."""

from dataclasses import dataclass
from typing import Protocol

from lidarplace.logs.box_log import BoxLog


class Recording(Protocol):
    """Settings and plain data that the log of a part depends on: a frozen dataclass."""

    def record(self) -> BoxLog:
        """Record the log, the same at each call."""


@dataclass(frozen=True)
class ScenePart:
    """A part of a scene."""

    name: str  # what is added to the scene's label; empty if the scene has one part
    recording: Recording  # gives its log
    splits: tuple[str, ...]  # "train", "test" or both: what its frames are for
