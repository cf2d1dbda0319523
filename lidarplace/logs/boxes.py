"""The box log: columns of its tables, and checks of boxes; metres and radians.

`boxes` has one row a box, in the ego frame; `frames` lists every frame, so that frames without a
box count too. `frame` is unique within a log. `lidarplace.logs.box_log` holds the tables together.
"""

import reprlib
from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.class_names import check_class_name, is_class_name
from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns, numbers, sizes
from lidarplace.rigs.pose import rotation

CLASSES = ("Car", "Cyclist", "Pedestrian")
"""The classes of simulated traffic, and those that are meant unless others are named: KITTI's. Here
Cyclist is the paper's *Van and Cyclist*: bicycles, motorcycles, box trucks."""
GEOMETRY = ("x", "y", "z", "length", "width", "height", "yaw")
"""A box: centre, size, and yaw about z from the ego x axis."""
SIZE = GEOMETRY[3:6]
BOX_COLUMNS = ("scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY)
FRAME_COLUMNS = ("scene", "frame", "timestamp_s", "route", "split")
SPLITS = ("train", "test")  # what a frame is for
POSE_COLUMNS = ("ego_x", "ego_y", "ego_yaw")
"""Pose of the vehicle in the world frame of its scene; a log may lack it."""
FULL_POSE_COLUMNS = ("ego_z", "ego_roll", "ego_pitch")
"""The rest of its pose, for logs that know all of it: metres, and radians about our axes."""
VIEWPOINT_Z = "viewpoint_z"
"""Column of frames of a site: height of the ideal sensor that decides which objects count,
metres."""
CLOUD = "cloud"
"""Column of frames that a reader adds: the file of the frame's real cloud, relative to the folder
of a data set's clouds, or a tuple of `CloudFile`. No log on disk has it."""
SOURCE = "source"  # column of frames that a reader may add: how the source calls the frame
BUILDING_COLUMNS = ("scene", *GEOMETRY)  # a building: a box in the world frame of its scene
POINTS = "points"
"""Column of the real points in a box, of all LiDARs; NaN where unknown. `points/NAME` holds those
of the LiDAR NAME of the recorded rig."""


def full_poses(frames: pd.DataFrame) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return rotation (3, 3) and position (3,) of the vehicle in the scene's world, by frame.

    Height, roll and pitch are 0 where they are not known, so the world is level there. Frames
    without a finite pose are left out. Needs `POSE_COLUMNS`."""
    names = (*POSE_COLUMNS, *FULL_POSE_COLUMNS)
    table = frames.reindex(columns=[*names]).apply(pd.to_numeric, errors="coerce")
    table[list(FULL_POSE_COLUMNS)] = table[list(FULL_POSE_COLUMNS)].fillna(0.0)
    poses = zip(frames["frame"].tolist(), table.to_numpy(np.float64), strict=True)
    return {
        frame: (rotation(roll, pitch, yaw), np.array([x, y, z]))
        for frame, (x, y, yaw, z, roll, pitch) in poses
        if np.isfinite([x, y, yaw]).all()
    }


def geometry_of(
    centre: NDArray[np.float64], size: NDArray[np.float64], yaw: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return columns of `GEOMETRY` from centres, (n, 3), sizes, (n, 3), and yaws, (n,)."""
    return dict(zip(GEOMETRY, (*centre.T, *size.T, yaw), strict=True))


def check_boxes(boxes: pd.DataFrame, source: str = "box log") -> None:
    """Raise ValueError that names the column or row, unless `boxes` can be used.

    Needs `frame`, `class` and the columns of `GEOMETRY`, with finite values and sizes >= 0, and no
    frame (or scene, where there is one) missing."""
    if not isinstance(boxes, pd.DataFrame):
        raise InputError(place=source, expected="a DataFrame", found=reprlib.repr(boxes))
    check_columns(list(boxes.columns), ("frame", "class", *GEOMETRY), source)
    for name in frame_keys(boxes):
        if (row := first(boxes[name].isna())) is not None:
            raise InputError("missing value", place=f"{source}: row {row}", key=name)
    numbers(boxes, GEOMETRY, source)
    sizes(boxes, SIZE, source)


def check_classes(boxes: pd.DataFrame, source: str) -> None:
    """Raise ValueError that names the first row whose class is not a valid name."""
    try:
        names = boxes["class"].unique()
    except TypeError:  # lists or mappings
        raise InputError(place=source, key="class", expected="names of classes") from None
    if wrong := [name for name in names if not is_class_name(name)]:
        row = first(boxes["class"].isna() if pd.isna(wrong[0]) else boxes["class"] == wrong[0])
        fix = "convert table --class-map names classes"
        check_class_name(wrong[0], place=f"{source}: row {row}", key="class", fix=fix)


def first(bad: ArrayLike) -> int | None:
    """Return the first row that is `bad`, (rows,), bool; None if none is."""
    rows = np.flatnonzero(np.asarray(bad, bool))
    return int(rows[0]) if len(rows) else None


def rows_of(source: object) -> Callable[[int], str]:
    """Return a function that names rows of a file, for messages."""
    return lambda row: f"{source}: row {row}"


def points_of(boxes: pd.DataFrame) -> dict[str, str]:
    """Return the column of real points of each LiDAR, by its name; empty where none is known."""
    head = f"{POINTS}/"
    return {name.removeprefix(head): name for name in boxes.columns if name.startswith(head)}


def count_columns(boxes: pd.DataFrame) -> list[str]:
    """Return the columns of real points that are there, `POINTS` first."""
    return [name for name in (POINTS, *points_of(boxes).values()) if name in boxes.columns]


def frame_ids(table: pd.DataFrame) -> np.ndarray:
    """Number the frame of each row, from 0 by order of `frame_keys`; shape (rows,), int64."""
    groups = table.groupby(frame_keys(table), sort=True, observed=True)
    return groups.ngroup().to_numpy(np.int64)


def frame_keys(*tables: pd.DataFrame) -> list[str]:
    """Return columns that name a frame in all `tables`: `scene`, if they have it, and `frame`."""
    return ["scene"] * all("scene" in table.columns for table in tables) + ["frame"]


def corners(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of boxes (m, 7), rows of `GEOMETRY`; shape (m, 8, 3), metres.

    Corner n is in front if bit 0 of n is set, on the left for bit 1, at the top for bit 2."""
    signs = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)]) - 0.5
    local = signs * boxes[:, None, 3:6]
    c, s = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    turned = [
        c * local[..., 0] - s * local[..., 1],
        s * local[..., 0] + c * local[..., 1],
        local[..., 2],
    ]
    return boxes[:, None, :3] + np.stack(turned, axis=-1)
