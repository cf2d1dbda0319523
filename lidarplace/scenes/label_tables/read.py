"""A label file, read by its mapping."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.class_names import IGNORE
from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.files.columns import counts_if_known, numbers, sizes, texts
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import FRAME_COLUMNS, GEOMETRY, POINTS, POSE_COLUMNS, SIZE, first
from lidarplace.logs.plausibility import over_two_turns
from lidarplace.scenes.datasets.class_maps import classified
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.datasets.tabular import read_table
from lidarplace.scenes.label_tables.frames import Stamps, frames_of, read_stamps
from lidarplace.scenes.label_tables.mapping import EgoPoses, TableMapping
from lidarplace.scenes.label_tables.units import METRES, RADIANS, SECONDS

SLACK_S = 0.1  # boxes may be by so much earlier than the first pose, or later than the last


class Track(NamedTuple):
    """Poses of the drives as the file has them, between which others are interpolated."""

    stamps: Stamps
    pose: NDArray[np.float64]
    source: str
    slack: float

    def at(self, stamps: Stamps) -> Poses:
        """Interpolate level poses of the file's vehicle frame at these times; ValueError beyond."""
        poses = np.empty((len(stamps.value), 4))
        for drive in pd.unique(stamps.drive):
            rows, of_drive = stamps.drive == drive, self.stamps.drive == drive
            time, first = np.unique(self.stamps.value[of_drive], return_index=True)
            value = stamps.value[rows]
            if not len(time):
                raise InputError(f"no pose of drive {drive!r}", place=self.source, key="poses")
            outside = (value < time[0] - self.slack) | (value > time[-1] + self.slack)
            if outside.any():
                problem = (
                    f"{percent(outside.mean(), '.1f')} of the times of drive {drive!r} have none"
                )
                expected = f"{time[0]:.16g} to {time[-1]:.16g}"
                parts = {"expected": expected, "found": f"{value[np.argmax(outside)]:.16g}"}
                raise InputError(problem, place=self.source, key="poses", **parts)
            pose = self.pose[of_drive][first]
            pose[:, 3] = np.unwrap(pose[:, 3])
            poses[rows] = np.stack([np.interp(value, time, column) for column in pose.T], 1)
        return Poses(poses[:, :3], Rotation.from_rotvec(poses[:, 3:] * [0.0, 0.0, 1.0]))


def read_track(table: pd.DataFrame, mapping: TableMapping, poses: EgoPoses, source: str) -> Track:
    """Read the poses that the mapping names, of `table` or of a file of their own.

    Raises ValueError for missing columns and implausible yaws."""
    drive, stamp = mapping.columns.drive, mapping.stamp
    if poses.file is not None:
        drive, stamp = poses.drive or drive, poses.stamp or stamp
        table, source = read_table(poses.file, [drive] if drive else []), str(poses.file)
    names = {f"poses.{key}": getattr(poses, key) for key in ("x", "y", "z", "yaw")}
    check_mapped(table, names | {"poses.drive": drive, "poses.stamp": stamp}, source)
    of_time = mapping.columns.time is not None
    pose = np.zeros((len(table), 4))
    units = [METRES[poses.position]] * 3 + [RADIANS[poses.angle or mapping.units.angle]]
    for column, (name, unit) in enumerate(zip(names.values(), units, strict=True)):
        if name is not None:
            pose[:, column] = numbers(table, [name], source)[:, 0] * unit
    turned = over_two_turns(pose[:, 3])
    if (row := first(turned)) is not None and "poses" not in mapping.accept:
        problem = f"{percent(turned.mean(), '.1f')} of the rows are over two turns of radians, the "
        problem += f"first is row {row} with {pose[row, 3]:g}"
        fix = "change poses.angle of the mapping, or accept the values: accept: [poses]"
        raise InputError(problem, place=source, key=poses.yaw, fix=fix)
    slack = SLACK_S / SECONDS[mapping.units.time] if of_time else 0.0
    return Track(read_stamps(table, drive, stamp, not of_time, source), pose, source, slack)


def read_label_table(path: Path, mapping: TableMapping, ignored: Counter[str]) -> BoxLog:
    """Read the boxes of a label file, a row a box; its frames have poses if the mapping has.

    `ignored` gets the number of boxes left out by category. Raises ValueError that names file and
    column if one is missing, a value is none, a category is in no class, an object is twice in a
    frame, or time stamps, drives or poses do not fit."""
    columns, source = mapping.columns, str(path)
    names = (columns.drive, columns.object, columns.category)
    table = read_table(path, filter(None, names))
    check_mapped(table, {f"columns.{key}": name for key, name in columns}, source)
    stamps = read_stamps(table, columns.drive, mapping.stamp, columns.time is None, source)
    frames, frame = frames_of(stamps, mapping, source)
    boxes = pd.DataFrame(_geometry(table, mapping, source), columns=list(GEOMETRY))
    poses = None
    if mapping.poses is not None:
        track = read_track(table, mapping, mapping.poses, source)
        poses = track.at(Stamps(frames["scene"].to_numpy(), frames["stamp"].to_numpy()))
        if mapping.coordinates == "world":
            vehicle = track.at(stamps)
            boxes[list("xyz")] = Poses.of_boxes(boxes).seen_from(vehicle).position
            boxes["yaw"] -= vehicle.yaw
    for axis in "xyz":
        boxes[axis] += getattr(mapping.origin, axis)
    boxes["class"] = _classes(table, mapping, source)
    boxes["scene"], boxes["frame"] = stamps.drive, frame
    boxes["timestamp_s"] = frames["timestamp_s"].to_numpy()[frame]
    ids = texts(table, columns.object, source) if columns.object else boxes.index.map(str)
    boxes["object_id"] = ids
    if columns.points is not None:
        boxes[POINTS] = counts_if_known(table, columns.points, source)
    ignored.update(texts(table, columns.category, source)[boxes["class"] == IGNORE])
    _check_objects(boxes[boxes["class"] != IGNORE], mapping, source)
    frames = frames[list(FRAME_COLUMNS)]
    if poses is not None:
        ego = poses.moved([-mapping.origin.x, -mapping.origin.y, -mapping.origin.z]).ego_columns()
        frames = frames.assign(**{name: ego[name] for name in POSE_COLUMNS})
    return BoxLog(classified(boxes), frames)


def _geometry(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.float64]:
    """Return rows of `GEOMETRY` in metres and radians, z at the centre; (rows, 7)."""
    columns, units = mapping.columns, mapping.units
    place = numbers(table, [columns.x, columns.y, columns.z], source) * METRES[units.position]
    size = sizes(table, [getattr(columns, side) for side in SIZE], source) * METRES[units.size]
    if mapping.box_z == "bottom":
        place[:, 2] += size[:, 2] / 2
    yaw = numbers(table, [columns.yaw], source) * RADIANS[units.angle]
    return np.hstack([place, size, yaw])


def _classes(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.object_]:
    column = mapping.columns.category
    category = texts(table, column, source)
    unknown = np.array([name not in mapping.classes for name in category])
    if (row := first(unknown)) is not None:
        counts = Counter(category[unknown])
        names = ", ".join(f"{name} {count:,}" for name, count in counts.most_common(10))
        problem = (
            f"{percent(unknown.mean(), '.1f')} of the rows, from row {row}, have a category that "
        )
        problem += f"`classes` does not name: {names}"
        raise InputError(problem, place=source, key=column, fix="null leaves one out")
    return np.array([mapping.classes[name] or IGNORE for name in category], object)


def _check_objects(boxes: pd.DataFrame, mapping: TableMapping, source: str) -> None:
    """Raise ValueError if an object is twice in a frame; `boxes` have the rows of the file."""
    twice = boxes.duplicated(["frame", "object_id"])
    if twice.any():
        box = boxes[twice].iloc[0]
        problem = f"{percent(twice.mean(), '.1f')} of the rows repeat an object in its frame, the "
        problem += (
            f"first is row {twice.idxmax()} with {box['object_id']!r} of drive {box['scene']!r}"
        )
        fix = "change columns.object, columns.drive, or the key of frames: "
        fix += f"{mapping.stamp}, units.time and frames.rate_hz"
        raise InputError(problem, place=source, key=mapping.column("object"), fix=fix)


def check_mapped(table: pd.DataFrame, names: Mapping[str, str | None], source: str) -> None:
    """Raise ValueError for a column, by key of the mapping, that is not there, or for no rows."""
    for key, name in names.items():
        if name is not None and name not in table.columns:
            listed = ", ".join(map(str, table.columns)) or "none"
            raise InputError(f"no column {name!r}", place=source, key=key, found=listed[:300])
    if table.empty:
        raise InputError("no rows", place=source)
