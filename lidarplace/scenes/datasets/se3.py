"""Rigid motions in space, many at once: where vehicles and objects are in a data set."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from lidarplace.logs.boxes import FULL_POSE_COLUMNS, POSE_COLUMNS
from lidarplace.rigs.rotations import rotations


@dataclass(frozen=True)
class Poses:
    """N poses in one frame, or each in a frame of its own."""

    position: NDArray[np.float64]  # origins, shape (N, 3), metres
    rotation: Rotation  # N that take directions of the posed frame to the outer one

    @classmethod
    def of_boxes(cls, boxes: pd.DataFrame) -> "Poses":
        """Return the poses of boxes, from their `GEOMETRY`."""
        turns = Rotation.from_euler("z", boxes[["yaw"]].to_numpy(np.float64))
        return cls(boxes[list("xyz")].to_numpy(np.float64, copy=True), turns)

    def __getitem__(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> "Poses":
        # Not self.rotation[rows], which refuses to take nothing from nothing.
        return Poses(self.position[rows], Rotation.from_quat(self.rotation.as_quat()[rows]))

    def moved(self, offset: ArrayLike) -> "Poses":
        """Move the origins by `offset`: metres in the posed frames, (3,) or (N, 3)."""
        return Poses(self.position + self.rotation.apply(offset), self.rotation)

    def seen_from(self, frames: "Poses") -> "Poses":
        """Return pose n in the frame that `frames` poses n-th in the same outer frame."""
        back = frames.rotation.inv()
        return Poses(back.apply(self.position - frames.position), back * self.rotation)

    def posed_by(self, frames: "Poses") -> "Poses":
        """Return pose n of the frame that `frames` poses n-th, in its outer frame.

        Undoes `seen_from`."""
        position = frames.position + frames.rotation.apply(self.position)
        return Poses(position, frames.rotation * self.rotation)

    def matrices(self) -> NDArray[np.float64]:
        """Return matrices from the posed frames to the outer ones, (N, 3, 4)."""
        turns = self.rotation.as_matrix().reshape(-1, 3, 3)
        return np.concatenate([turns, self.position[:, :, None]], axis=2)

    def ego_columns(self) -> dict[str, NDArray[np.float64]]:
        """Return `POSE_COLUMNS` and `FULL_POSE_COLUMNS` of a vehicle in the world; (N,) each."""
        matrix = self.rotation.as_matrix().reshape(-1, 3, 3)
        x, y, z = self.position.T
        level = np.hypot(matrix[:, 0, 0], matrix[:, 1, 0])
        roll = np.arctan2(matrix[:, 2, 1], matrix[:, 2, 2])
        pitch = np.arctan2(-matrix[:, 2, 0], level)
        columns = (*POSE_COLUMNS, *FULL_POSE_COLUMNS)
        return dict(zip(columns, (x, y, self.yaw, z, roll, pitch), strict=True))

    @property
    def yaw(self) -> NDArray[np.float64]:
        """Angle of the posed x axis, seen from above, from the outer one; (N,), in (-pi, pi]."""
        x, y, _ = self.rotation.apply([1.0, 0.0, 0.0]).reshape(-1, 3).T
        return np.asarray(np.arctan2(y, x))


def poses(
    position: NDArray[np.float64], quaternion: NDArray[np.float64], row: Callable[[int], str]
) -> Poses:
    """Build poses from positions, (N, 3), and quaternions w, x, y, z, (N, 4).

    Raises InputError for a quaternion whose length is not 1; `row` names its row."""
    return Poses(position, rotations(quaternion[:, [1, 2, 3, 0]], row))


def concatenated(parts: Sequence[Poses]) -> Poses:
    """Join poses, one after the other."""
    quaternions = np.concatenate([part.rotation.as_quat().reshape(-1, 4) for part in parts])
    return Poses(np.concatenate([part.position for part in parts]), Rotation.from_quat(quaternions))
