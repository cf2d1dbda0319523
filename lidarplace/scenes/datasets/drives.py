"""The drives of a data set, one after the other as a box log, and the rigs that recorded them."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import angles
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.class_maps import classified
from lidarplace.scenes.datasets.se3 import Poses

Models = Lidar | Mapping[str, Lidar] | None
"""Model of all LiDARs of a rig, or models by their names, or None where a reader knows them."""
Drive = tuple[pd.DataFrame, pd.DataFrame, RecordedRig | None]
"""Boxes with their classes, or `IGNORE`; frames without `route` and `split`; and the rig."""


def drives_in(
    folder: Path, splits: Sequence[str], split_of: Mapping[str, str], pattern: str, each: str
) -> list[tuple[Path, str]]:
    """List the drives in `folder/<split>`, and the split of a box log that each is for.

    `split_of` maps folders of the data set to these; without `splits` its first two are meant, or
    the one that is there. `each` is what there must be for each drive. Raises ValueError if a split
    is unknown, or a folder has no path of the pattern."""
    if unknown := [split for split in splits if split not in split_of]:
        raise InputError(place="--split", expected=", ".join(split_of), found=repr(unknown[0]))
    usual, drives = [*split_of][:2], []
    for split in splits or [name for name in usual if (folder / name).is_dir()]:
        paths = sorted((folder / split).glob(pattern))
        if not paths:
            raise InputError(place=(folder / split / pattern).parent, expected=each)
        drives += [(path, split_of[split]) for path in paths]
    if not drives:
        raise InputError(place=folder, expected=f"a folder {' or '.join(usual)}")
    return drives


def join_drives(drives: Sequence[tuple[Path, str]], read: Callable[[Path, int], Drive]) -> BoxLog:
    """Join drives as a box log; `read` has a path, and the number of the first frame."""
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    rigs: dict[str, RecordedRig] = {}
    for route, (path, split) in enumerate(drives):
        boxes_of_drive, frames_of_drive, rig = read(path, sum(map(len, frames)))
        boxes.append(boxes_of_drive)
        frames.append(frames_of_drive.assign(route=route, split=split))
        if rig is not None and len(frames_of_drive):
            rigs[frames_of_drive["scene"].iloc[0]] = rig
    all_boxes = classified(pd.concat(boxes, ignore_index=True))
    return BoxLog(all_boxes, pd.concat(frames, ignore_index=True), rigs=rigs)


def in_frames(
    frames: pd.DataFrame, rows: NDArray[np.int64], columns: Mapping[Any, Any]
) -> pd.DataFrame:
    """Make a table of boxes, each in a row of `frames`, whose scene, number and time it gets."""
    names = ("scene", "frame", "timestamp_s")
    return pd.DataFrame({name: frames[name].to_numpy()[rows] for name in names} | dict(columns))


def models_of(
    names: Sequence[str], lidar: Models, defaults: Mapping[str, Lidar] = MappingProxyType({})
) -> list[Lidar]:
    """Return the models of a rig's LiDARs: `lidar`, the one of its name, or `defaults` of its name.

    Raises ValueError if one is unknown, or no LiDAR has the name."""
    if isinstance(lidar, Lidar):
        return [lidar] * len(names)
    named = {**defaults, **(lidar or {})}
    if other := [name for name in lidar or () if name not in names]:
        expected = f"models of {', '.join(names)}"
        raise InputError(place="--lidar", expected=expected, found=other[0])
    if unknown := [name for name in names if name not in named]:
        fix = f"name it: --lidar {','.join(f'{name}=MODEL' for name in unknown)}"
        raise InputError(f"unknown model of {', '.join(unknown)}", fix=fix)
    return [named[name] for name in names]


def recorded_rig(
    name: str, names: Sequence[str], sensors: Poses, lidars: Sequence[Lidar]
) -> RecordedRig:
    """Build a rig of sensors posed in our ego frame.

    `names`, `sensors` and `lidars` are in one order."""
    matrices = sensors.rotation.as_matrix().reshape(-1, 3, 3)
    mounts = [
        Mount(x, y, z, *angles(matrix))
        for (x, y, z), matrix in zip(sensors.position.tolist(), matrices, strict=True)
    ]
    return RecordedRig(tuple(names), Placement(name, mounts, lidars))
