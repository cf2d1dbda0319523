"""Where the vehicle was at the times of a label file, and boxes of the world as it saw them."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.files.columns import numbers
from lidarplace.logs.plausible import MOST_YAW
from lidarplace.scenes.label_tables.frames import Stamps, read_stamps
from lidarplace.scenes.label_tables.mapping import EgoPoses, Origin, TableMapping
from lidarplace.scenes.label_tables.read_table import check_mapped, read_table
from lidarplace.scenes.label_tables.units import METRES, RADIANS, SECONDS

SLACK_S = 0.1
"""Boxes may be by so much earlier than the first pose, or later than the last."""


@dataclass(frozen=True)
class VehiclePoses:
    """Poses of the label file's vehicle frame, level, at given times.

    Attributes:
        position: x, y, z in the world, metres, shape (n, 3).
        yaw: radians within a turn, shape (n,).
    """

    position: NDArray[np.float64]
    yaw: NDArray[np.float64]

    def seen(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Box n of the world, rows of `GEOMETRY`, shape (n, 7), in the frame of pose n."""
        x, y, z = (boxes[:, :3] - self.position).T
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        place = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=1)
        return np.column_stack([place, boxes[:, 3:6], boxes[:, 6] - self.yaw])

    def ego(self, origin: Origin) -> pd.DataFrame:
        """Poses of our ego frame, columns `POSE_COLUMNS`."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return pd.DataFrame(
            {
                "ego_x": self.position[:, 0] - cos * origin.x + sin * origin.y,
                "ego_y": self.position[:, 1] - sin * origin.x - cos * origin.y,
                "ego_yaw": self.yaw,
            }
        )


@dataclass(frozen=True)
class Track:
    """Poses of the drives as the file has them, between which others are interpolated."""

    stamps: Stamps
    pose: NDArray[np.float64]
    source: str
    slack: float

    def at(self, stamps: Stamps) -> VehiclePoses:
        """Poses at these times, straight lines between those that are known.

        Raises:
            ValueError: a time is not within those of its drive.
        """
        found = np.empty((len(stamps.value), 4))
        for drive in pd.unique(stamps.drive):
            asked, own = stamps.drive == drive, self.stamps.drive == drive
            time, first = np.unique(self.stamps.value[own], return_index=True)
            value = stamps.value[asked]
            if not len(time):
                raise ValueError(f"{self.source}: poses: no pose of drive {drive!r}")
            outside = (value < time[0] - self.slack) | (value > time[-1] + self.slack)
            if outside.any():
                raise ValueError(
                    f"{self.source}: poses: {outside.mean():.1%} of the times of drive {drive!r} "
                    f"have none, the first is {value[np.argmax(outside)]:.16g}; poses are from "
                    f"{time[0]:.16g} to {time[-1]:.16g}"
                )
            pose = self.pose[own][first]
            pose[:, 3] = np.unwrap(pose[:, 3])
            found[asked] = np.stack([np.interp(value, time, column) for column in pose.T], 1)
        return VehiclePoses(found[:, :3], np.arctan2(np.sin(found[:, 3]), np.cos(found[:, 3])))


def read_track(table: pd.DataFrame, mapping: TableMapping, poses: EgoPoses, source: str) -> Track:
    """The poses that the mapping names, of `table` or of a file of their own.

    Raises:
        ValueError: the file cannot be read, lacks a column, or a value is wrong.
    """
    drive, stamp = mapping.columns.drive, mapping.stamp
    if poses.file is not None:
        drive, stamp = poses.drive or drive, poses.stamp or stamp
        table, source = read_table(poses.file, [drive]), str(poses.file)
    names = {f"poses.{key}": getattr(poses, key) for key in ("x", "y", "z", "yaw")}
    check_mapped(table, names | {"poses.drive": drive, "poses.stamp": stamp}, source)
    if table.empty:
        raise ValueError(f"{source}: has no row")
    of_time = mapping.columns.time is not None
    pose = np.zeros((len(table), 4))
    for column, name in enumerate(names.values()):
        if name is not None:
            unit = (
                RADIANS[poses.angle or mapping.units.angle]
                if column == 3
                else METRES[poses.position]
            )
            pose[:, column] = numbers(table, [name], source)[:, 0] * unit
    turned = np.abs(pose[:, 3]) > MOST_YAW
    if turned.any() and "poses" not in mapping.accept:
        row = int(np.argmax(turned))
        raise ValueError(
            f"{source}: column {poses.yaw}: yaw is in radians; over two turns: {turned.mean():.1%} "
            f"of the rows, the first is row {row} with {pose[row, 3]:g}; mend poses.angle of the "
            "mapping; if it is meant: accept: [poses]"
        )
    return Track(
        read_stamps(table, drive, stamp, not of_time, source),
        pose,
        source,
        SLACK_S / SECONDS[mapping.units.time] if of_time else 0.0,
    )
