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
from lidarplace.files.columns import counts_if_known, numbers, row_name, sizes, texts
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import FRAME_COLUMNS, GEOMETRY, POINTS, POSE_COLUMNS, SIZE, first
from lidarplace.logs.convention import Convention
from lidarplace.logs.plausibility import over_two_turns
from lidarplace.rigs.rotations import TILTED, rotations
from lidarplace.scenes.datasets.class_maps import classified
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.label_tables.files import FOLDER, read_label_file
from lidarplace.scenes.label_tables.frames import Stamps, frames_of, read_stamps
from lidarplace.scenes.label_tables.mapping import EgoPoses, Heading, TableMapping, names_in
from lidarplace.scenes.label_tables.units import SECONDS

MOST_TILTED = 0.1  # share of boxes: a vehicle on its side, but not each tenth
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
        table, source = read_label_file(poses.file, [drive] if drive else []), str(poses.file)
    keys = ("x", "y", "z", "yaw", "quaternion", "direction")
    names = {f"poses.{key}": name for key, name in names_in(poses, *keys).items()}
    check_mapped(table, names | {"poses.drive": drive, "poses.stamp": stamp}, source)
    unit, convention = mapping.stamp_unit, mapping.of_poses()
    place = _wide(numbers(table, [*names_in(poses, "x", "y", "z").values()], source))
    yaw = _yaws(table, poses, convention, source)
    turned = over_two_turns(yaw - convention.turn)
    if (row := first(turned)) is not None and "poses" not in mapping.accept:
        problem = f"{percent(turned.mean(), '.1f')} of the rows are over two turns of radians, the "
        problem += f"first is {row_name(table, row)} with {yaw[row] - convention.turn:g}"
        fix = "change poses.angle of the mapping, or accept the values: accept: [poses]"
        key = mapping.column("ego_yaw")
        raise InputError(problem, place=source, key=key, fix=fix)
    slack = 0.0 if unit is None else SLACK_S / SECONDS[unit]
    pose = np.column_stack([convention.places(place), yaw])
    return Track(read_stamps(table, drive, stamp, unit, source), pose, source, slack)


def _yaws(
    table: pd.DataFrame, columns: Heading, convention: Convention, source: str
) -> NDArray[np.float64]:
    """Return yaws in our axes, radians, (rows,), of any way to write a heading."""
    if columns.yaw is not None:
        return convention.yaws(numbers(table, [columns.yaw], source)[:, 0])
    names = list(names_in(columns, "quaternion", "direction").values())
    values, key = numbers(table, names, source), ", ".join(names)
    if columns.quaternion is not None:
        turns = rotations(values, lambda row: f"{source}: {row_name(table, row)}: {key}")
        matrices, upright = turns.as_matrix().reshape(-1, 3, 3), convention.matrix[2]
        tilted = matrices @ upright @ upright < TILTED
        if tilted.sum() > MOST_TILTED * len(tilted):
            problem = f"{percent(tilted.mean(), '.1f')} are tilted by more than 30 degrees, the "
            problem += f"first is {row_name(table, int(np.argmax(tilted)))}"
            fix = "change which column of the quaternion is x, y, z and w, or axes"
            raise InputError(problem, place=source, key=key, fix=fix)
        return convention.yaws_of(matrices)
    directions = _wide(values)
    if (row := first(~convention.places(directions)[:, :2].any(axis=1))) is not None:
        place = f"{source}: {row_name(table, row)}"
        raise InputError("the direction is 0 along the ground", place=place, key=key)
    return convention.yaws_along(directions)


def _wide(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors with a third component, 0 where there is none; (n, 3)."""
    return np.hstack([values, np.zeros((len(values), 3 - values.shape[1]))])


def read_label_table(path: Path, mapping: TableMapping, ignored: Counter[str]) -> BoxLog:
    """Read the boxes of a label file, a row a box; its frames have poses if the mapping has.

    `ignored` gets the number of boxes left out by category. Raises ValueError that names file and
    column if one is missing, a value is none, a category is in no class, an object is twice in a
    frame, or time stamps, drives or poses do not fit."""
    columns = mapping.columns
    names = (columns.drive, columns.object, columns.category)
    return read_labels(read_label_file(path, filter(None, names)), mapping, ignored, str(path))


def read_labels(
    table: pd.DataFrame, mapping: TableMapping, ignored: Counter[str], source: str
) -> BoxLog:
    """Read the boxes of a table, see `read_label_table`.

    A row that has drive and time but nothing of a box is a frame, which may be empty."""
    columns = mapping.columns
    if len(candidates := mapping.candidates()) > 1:
        problem = f"{' and '.join(candidates)} fit the values"
        key, fix = "yaw.sense" if mapping.yaw.is_open else "anchor", "--preview PAGE draws both"
        raise InputError(problem, key=key, expected="one of the two", fix=fix)
    check_mapped(table, {f"columns.{key}": name for key, name in names_in(columns).items()}, source)
    if columns.drive is None and FOLDER in table and len(set(table[FOLDER])) > 1:
        problem = f"{len(set(table[FOLDER]))} folders of frames, but no drive"
        raise InputError(problem, place=source, key="columns.drive", fix=f"write `drive: {FOLDER}`")
    stamps = read_stamps(table, columns.drive, mapping.stamp, mapping.stamp_unit, source)
    frames, frame = frames_of(stamps, mapping, source)
    of_box = [n for key, n in names_in(columns).items() if key not in ("drive", "time", "frame")]
    if not (filled := table[of_box].notna().any(axis=1).to_numpy()).all():
        table, frame = table[filled], frame[filled]
        stamps = Stamps(stamps.drive[filled], stamps.value[filled])
    boxes = pd.DataFrame(_geometry(table, mapping, source), columns=list(GEOMETRY))
    poses = None
    if mapping.poses is not None:
        track = read_track(table, mapping, mapping.poses, source)
        poses = track.at(Stamps(frames["scene"].to_numpy(), frames["stamp"].to_numpy()))
        if mapping.coordinates == "world":
            vehicle = track.at(stamps)
            boxes[list("xyz")] = Poses.of_boxes(boxes).seen_from(vehicle).position
            boxes["yaw"] -= vehicle.yaw
    turn = Rotation.from_euler("z", [[mapping.origin.yaw]])
    origin = Poses(np.array([mapping.origin.xyz]), turn)[np.zeros(len(boxes), np.int64)]
    boxes[list("xyz")] = Poses.of_boxes(boxes).posed_by(origin).position
    boxes["yaw"] += mapping.origin.yaw
    boxes["class"] = _classes(table, mapping, source)
    boxes["scene"], boxes["frame"] = stamps.drive, frame
    boxes["timestamp_s"] = frames["timestamp_s"].to_numpy()[frame]
    ids = texts(table, columns.object, source) if columns.object else boxes.index.map(str)
    boxes["object_id"] = ids
    if columns.points is not None:
        boxes[POINTS] = counts_if_known(table, columns.points, source)
    ignored.update(texts(table, columns.category, source)[boxes["class"] == IGNORE])
    in_file = boxes.set_axis(table.index)
    _check_objects(in_file[boxes["class"].to_numpy() != IGNORE], mapping, source)
    frames = frames[list(FRAME_COLUMNS)]
    if poses is not None:
        ego_in_file = turn.inv().apply([-value for value in mapping.origin.xyz])
        ego = Poses(poses.moved(ego_in_file).position, poses.rotation * turn.inv()).ego_columns()
        frames = frames.assign(**{name: ego[name] for name in POSE_COLUMNS})
    return BoxLog(classified(boxes), frames)


def _geometry(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.float64]:
    """Return rows of `GEOMETRY` in our axes, metres and radians; (rows, 7)."""
    columns, convention = mapping.columns, mapping.of_boxes()
    place = numbers(table, [columns.x, columns.y, columns.z], source)
    size = sizes(table, [getattr(columns, side) for side in SIZE], source)
    return convention.boxes(place, size, _yaws(table, columns, convention, source))


def _classes(table: pd.DataFrame, mapping: TableMapping, source: str) -> NDArray[np.object_]:
    column = mapping.columns.category
    category = texts(table, column, source)
    unknown = np.array([name not in mapping.classes for name in category])
    if (row := first(unknown)) is not None:
        counts = Counter(category[unknown])
        names = ", ".join(f"{name} {count:,}" for name, count in counts.most_common(10))
        problem = (
            f"{percent(unknown.mean(), '.1f')} of the rows, from {row_name(table, row)}, have a "
        )
        problem += f"category that `classes` does not name: {names}"
        raise InputError(problem, place=source, key=column, fix="null leaves one out")
    return np.array([mapping.classes[name] or IGNORE for name in category], object)


def _check_objects(boxes: pd.DataFrame, mapping: TableMapping, source: str) -> None:
    """Raise ValueError if an object is twice in a frame; `boxes` have the rows of the file."""
    twice = boxes.duplicated(["frame", "object_id"])
    if twice.any():
        box, name = boxes[twice].iloc[0], row_name(boxes[twice], 0)
        problem = f"{percent(twice.mean(), '.1f')} of the rows repeat an object in its frame, the "
        problem += f"first is {name} with {box['object_id']!r} of drive {box['scene']!r}"
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
