"""The frames of a log as files of detections name them, and where the vehicle was in them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.logs.boxes import FULL_POSE_COLUMNS, POSE_COLUMNS, SOURCE, full_poses
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.kitti.folder import frame_name

Row = Callable[[int], str]
"""File and row of a detection, for messages."""


class LogFrames:
    """Finds frames of a log by name: their `SOURCE`, or their number as KITTI writes it."""

    def __init__(self, frames: pd.DataFrame) -> None:
        """Raises InputError if two frames have one name."""
        self._frames = frames
        numbers = frames["frame"].tolist()
        self._numbers = {frame_name(number): number for number in numbers}
        if SOURCE in frames:
            twice = frames[SOURCE].duplicated()
            if twice.any():
                name = frames.loc[twice, SOURCE].iloc[0]
                raise InputError("duplicate name of a frame", place="log", key=SOURCE, found=name)
            self._numbers |= dict(zip(frames[SOURCE].tolist(), numbers, strict=True))

    def named(self, names: Iterable[object], row: Row) -> NDArray[np.int64]:
        """Numbers of the frames of these names; (rows,). Raises InputError for an unknown name."""
        numbers = []
        for at, name in enumerate(names):
            number = self._numbers.get(str(name))
            if number is None:
                self._unknown(row(at), name, list(self._numbers)[-1:])
            numbers.append(number)
        return np.array(numbers, np.int64)

    def numbered(self, numbers: NDArray[np.int64], row: Row) -> NDArray[np.int64]:
        """The numbers themselves. Raises InputError for one that the log has not."""
        own = self._frames["frame"]
        unknown = ~np.isin(numbers, own)
        if unknown.any():
            at = int(np.argmax(unknown))
            self._unknown(row(at), numbers[at], own.tolist()[:1])
        return numbers

    def _unknown(self, place: str, found: object, known: Sequence[object]) -> None:
        such = f"a frame of the log, such as {known[0]}" if known else "a frame of the log"
        fix = None if SOURCE in self._frames else "`lidarplace convert` keeps the source's names"
        raise InputError("unknown frame", place=place, expected=such, found=str(found), fix=fix)

    def ego(self, numbers: NDArray[np.int64], row: Row, full: bool) -> Poses:
        """Pose of the vehicle in the world in these frames; (rows,).

        Args:
            full: whether height, roll and pitch are needed.

        Raises:
            InputError: the log does not know it.
        """
        needed = (*POSE_COLUMNS, *(FULL_POSE_COLUMNS if full else ()))
        missing = [name for name in needed if name not in self._frames]
        if missing:
            raise InputError(
                "boxes in the world need the pose of the vehicle",
                place="frames of the log",
                expected=", ".join(missing),
                fix="convert the log again",
            )
        known = full_poses(self._frames)
        unique, at = np.unique(numbers, return_inverse=True)
        for number in unique.tolist():
            if number not in known:
                place = row(int(np.argmax(numbers == number)))
                raise InputError(f"the log has no pose of frame {number}", place=place)
        rotation = np.array([known[number][0] for number in unique.tolist()]).reshape(-1, 3, 3)
        position = np.array([known[number][1] for number in unique.tolist()]).reshape(-1, 3)
        if not len(numbers):
            return Poses(position, Rotation.from_quat(np.empty((0, 4))))
        return Poses(position, Rotation.from_matrix(rotation))[at]
