"""The traffic of a studio: a log of which some frames are in memory, or a simulated one."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

from cachetools import LRUCache

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import BoxLog, evenly, join_logs, read_boxes, read_frames
from lidarplace.scenes.kinds import Scene, scene_parts
from lidarplace.scenes.site import Site
from lidarplace.scenes.sumo.record import record
from lidarplace.scenes.sumo.settings import SumoScene

PORTION = 200
"""Number of frames that are read at a time, in order: a player needs the next."""
PORTIONS = 4
"""Number of portions that are kept."""


class LogFrames:
    """Frames of a log, some of which are in memory, the others in `folder`; for several threads.

    Raises ValueError: the table of frames cannot be read."""

    def __init__(self, log: BoxLog, folder: Path | None = None) -> None:
        self._log, self._folder = log, folder
        self._frames = log.frames if folder is None else read_frames(folder)
        self.numbers: list[int] = self._frames["frame"].tolist()
        self._place = {number: place for place, number in enumerate(self.numbers)}
        self._in_memory = frozenset(log.frames["frame"].tolist())
        self._read: LRUCache[int, BoxLog] = LRUCache(PORTIONS)
        self._reading = threading.Lock()

    def check(self, number: int) -> None:
        """Raise ValueError if the log has no such frame."""
        if number not in self._place:
            first, last, count = min(self.numbers), max(self.numbers), len(self.numbers)
            frames = f"one of {count} frames, {first} to {last}"
            raise InputError(key="frame", expected=frames, found=number)

    def log_of(self, number: int) -> BoxLog:
        """Return a part of the log with this frame. Raises ValueError: missing or unreadable."""
        self.check(number)
        if number in self._in_memory or self._folder is None:
            return self._log
        portion = self._place[number] // PORTION
        with self._reading:
            if portion not in self._read:
                frames = self._frames.iloc[portion * PORTION : (portion + 1) * PORTION]
                boxes = read_boxes(self._folder, frames["frame"].tolist())
                self._read[portion] = replace(self._log, boxes=boxes, frames=frames)
            return self._read[portion]


def simulated_scene() -> SumoScene:
    """Return a generated town as three cars see it for half a minute: 180 frames, 60 to test."""
    return SumoScene(routes=2, test_routes=1, frames_per_route=60, frame_stride=10)


def simulated_traffic() -> BoxLog:
    """Record `simulated_scene`. Raises ModuleNotFoundError: SUMO is not installed."""
    return record(simulated_scene())


def traffic_at(scene: Scene, site: Site, most_frames: int) -> BoxLog:
    """Record a scene as a site sees it: its first parts, and of them at most so many frames.

    Raises ValueError as `scene_parts` does, and ModuleNotFoundError: SUMO is not installed."""
    logs: list[BoxLog] = []
    for part in scene_parts(scene, site):
        if sum(len(log.frames) for log in logs) < most_frames:
            logs.append(part.recording.record())
    log = join_logs(logs)
    frames = evenly(log.frames, most_frames).reset_index(drop=True)
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])].reset_index(drop=True)
    return replace(log, boxes=boxes, frames=frames)


def scene_of(log: Path | None, scene: Scene | None = None) -> dict[str, Any]:
    """Return the traffic as a sweep's configuration has it: a folder, a scene, or simulated."""
    if log is not None:
        return {"source": "log", "folder": str(log.absolute())}
    scene = scene or simulated_scene()
    return {"source": scene.source, **scene.model_dump(mode="json", exclude_unset=True)}
