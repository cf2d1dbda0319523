"""A box log from a folder in KITTI's object layout; labels are enough."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import IGNORE
from lidarplace.base.errors import InputError, at
from lidarplace.base.ranges import LIDAR_HEIGHT
from lidarplace.files.regular import files_in, is_there, regular
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, CLOUD, FRAME_COLUMNS, GEOMETRY, SOURCE
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.class_maps import KITTI, ClassMap, merged
from lidarplace.scenes.kitti.calibration import (
    LIDAR_HEIGHT_M,
    STANDARD,
    camera_to_ego,
    read_calibration,
)

SETS = {"train": "train", "val": "test"}  # lists in `ImageSets` -> split of the box log
STEPS = 2007  # of its HDL-64E, counted in raw sweeps: 2,005 to 2,008
_NUMBERS = 14  # fields of a line after the type, without the score


def frame_name(frame: int) -> str:
    """Name the files of a frame, without suffix."""
    return f"{frame:06d}"


def subfolder(folder: Path, name: str) -> Path:
    """Return the folder `name` of a data set, which lies in `training` or in `folder` itself."""
    training = folder / "training"
    return (training if training.is_dir() else folder) / name


def fault(error: ValueError, skipped: list[str] | None) -> None:
    """Add an error to those skipped, or raise it where none are."""
    if skipped is None:
        raise error
    skipped.append(str(error))


def read_kitti(
    folder: Path,
    *,
    class_map: ClassMap | None = None,
    standard_calibration: bool = False,
    lidar_height: float = LIDAR_HEIGHT_M,
    ignored: Counter[str] | None = None,
    skipped: list[str] | None = None,
    lidar: Lidar | None = None,
    keep_ignored: bool = False,
) -> BoxLog:
    """Read the frames of a KITTI-format folder as a box log.

    `label_2` and `calib` lie in `folder` or in `folder/training`, `ImageSets` in `folder`. The
    frames are those of `ImageSets/train.txt` and `val.txt`, the latter in the split test;
    without these lists every file of `label_2` is a frame of the split train. A frame keeps its
    number. KITTI knows no times, tracks or drives: `timestamp_s` is NaN, every box an object of its
    own, and a split one route. The centre of the vehicle is taken to be under the LiDAR, which is
    the log's rig.

    Args:
        folder: the data set.
        class_map: entries that differ from `class_maps.KITTI`.
        standard_calibration: do not read `calib`: the camera looks straight ahead from 0.27 m
            before and 0.08 m below the LiDAR.
        lidar_height: of the LiDAR above the ground, metres.
        ignored: gets the number of boxes left out by type.
        skipped: gets what is wrong with lines and frames, which are then left out.
        lidar: model of the LiDAR; None: HDL-64E as KITTI's turns.
        keep_ignored: keep boxes of ignored types as `class_maps.OTHER`, which hide.

    Raises OSError without labels, ValueError that names file and line if one is broken or of an
    unknown type, a calibration or a label file is missing, or no frame is left."""
    LIDAR_HEIGHT.check("lidar_height", lidar_height)
    types = merged(KITTI, class_map, keep_ignored)
    ignored = Counter() if ignored is None else ignored
    frames = _frames(folder, skipped)
    cameras = _cameras(folder, frames["frame"], standard_calibration, lidar_height, skipped)
    numbers, names, to_ego, placed = [], [], [], []
    for frame, transform in cameras:
        placed.append(frame)
        path = subfolder(folder, "label_2") / f"{frame_name(frame)}.txt"
        for line, name, values in read_labels(path, types, ignored, skipped):
            numbers.append(values[7:_NUMBERS])
            names.append((frame, f"{path.stem}-{line}", types[name]))
            to_ego.append(transform)
    if not placed:
        raise InputError("no frame can be used", place=folder)
    scene = folder.resolve().name
    frames = frames[frames["frame"].isin(placed)].reset_index(drop=True).assign(scene=scene)
    boxes = pd.DataFrame(names, columns=["frame", "object_id", "class"])
    boxes = boxes.astype({"frame": np.int64, "object_id": str, "class": str})
    geometry = in_ego(np.array(numbers).reshape(-1, 7), np.array(to_ego).reshape(-1, 3, 4))
    boxes = boxes.assign(scene=scene, timestamp_s=np.nan, **geometry)[list(BOX_COLUMNS)]
    frames[SOURCE] = frames["frame"].map(frame_name)
    frames[CLOUD] = "velodyne/" + frames[SOURCE] + ".bin"
    lidar = lidar or replace(Lidar.named("hdl64e"), azimuth_steps=STEPS)
    rig = RecordedRig(("velodyne",), Placement("kitti", [Mount(z=lidar_height)], lidar))
    return BoxLog(boxes, frames[[*FRAME_COLUMNS, CLOUD, SOURCE]], rigs={scene: rig})


def _cameras(
    folder: Path, frames: pd.Series, standard: bool, lidar_height: float, skipped: list[str] | None
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield the frames that have a camera, and its transform to the ego frame."""
    transform = camera_to_ego(STANDARD, lidar_height)
    for frame in frames.tolist():
        path = subfolder(folder, "calib") / f"{frame_name(frame)}.txt"
        try:
            if not standard:
                transform = camera_to_ego(read_calibration(path), lidar_height)
        except FileNotFoundError:
            problem = "no such file, so nothing places the camera"
            fix = "--standard-calibration takes KITTI's usual camera instead"
            fault(InputError(problem, place=path, fix=fix), skipped)
        except ValueError as error:
            fault(error, skipped)
        else:
            yield frame, transform


def _frames(folder: Path, skipped: list[str] | None) -> pd.DataFrame:
    """List the frames: columns frame, timestamp_s, split, route; sorted by frame."""
    labels = subfolder(folder, "label_2")
    if (tracking := subfolder(folder, "label_02")).is_dir() and not labels.is_dir():
        problem = "KITTI's tracking layout, a file a drive; only the object layout is read"
        fix = "make a table of its boxes in the ego frame, and read it by convert table --propose"
        raise InputError(problem, place=tracking, expected="a folder label_2", fix=fix)
    files = {path.stem for path in files_in(labels) if path.suffix == ".txt"}
    split_of: dict[int, str] = {}
    # Someone who names the folder `training` means its lists too, which lie next to it.
    lists = folder / "ImageSets"
    if not is_there(lists) and labels.parent == folder and folder.resolve().name == "training":
        lists = folder.resolve().parent / "ImageSets"
    names = {path.name for path in files_in(lists)} if is_there(lists) else set()
    listed = [name for name in SETS if f"{name}.txt" in names]
    for name in listed:
        path = lists / f"{name}.txt"
        for number, stem in _lines(path):
            where = f"{path}: line {number}"
            if not _is_name(stem):
                fault(InputError(place=where, expected="a number like 000123", found=stem), skipped)
            elif stem not in files:
                fault(InputError(f"no file {labels / stem}.txt", place=where), skipped)
            elif int(stem) in split_of:
                fault(InputError(f"duplicate frame {stem}", place=where), skipped)
            else:
                split_of[int(stem)] = SETS[name]
    if not listed:
        for stem in sorted(files):
            if _is_name(stem):
                split_of[int(stem)] = "train"
            else:
                place, expected = f"{labels / stem}.txt", "a name like 000123.txt"
                fault(InputError(place=place, expected=expected), skipped)
    if not split_of:
        raise InputError("no file of labels is among the frames", place=labels)
    columns = {"frame": list(split_of), "timestamp_s": np.nan, "split": split_of.values()}
    frames = pd.DataFrame(columns)
    frames["route"] = frames["split"].map([*SETS.values()].index)
    return frames.sort_values("frame", ignore_index=True)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text file that are not empty, stripped, with their numbers from 1."""
    text = regular(path).read_text(errors="replace")
    lines = enumerate((line.strip() for line in text.splitlines()), start=1)
    return ((number, line) for number, line in lines if line)


def _is_name(stem: str) -> bool:
    return stem.isascii() and stem.isdigit() and stem == frame_name(int(stem))


def read_labels(
    path: Path,
    types: Mapping[str, str],
    ignored: Counter[str],
    skipped: list[str] | None = None,
    fields_of_line: Sequence[int] = (_NUMBERS + 1, _NUMBERS + 2),
) -> list[tuple[int, str, list[float]]]:
    """Read the boxes of a file: line, type, and numbers, 14 and maybe a score.

    Counts those ignored. Raises ValueError that names file and line, unless `skipped` gets it."""
    expected = " or ".join(map(str, fields_of_line))
    labels = []
    for number, line in _lines(path):
        name, *texts = line.split()
        try:
            with at(f"{path}: line {number}"):
                if (fields := len(texts) + 1) not in fields_of_line:
                    raise InputError(expected=f"{expected} fields", found=fields)
                if name not in types:
                    parts = {"found": repr(name), "fix": "a class map can name more"}
                    raise InputError("unknown type", expected=", ".join(types), **parts)
                if types[name] == IGNORE:
                    ignored[name] += 1
                else:
                    labels.append((number, name, _numbers(line, texts)))
        except InputError as error:
            fault(error, skipped)
    return labels


def _numbers(line: str, texts: Sequence[str]) -> list[float]:
    try:
        values = [float(text) for text in texts]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise InputError(expected="finite numbers", found=repr(line))
    if min(values[7:10]) < 0:
        raise InputError(expected="sizes >= 0", found=values[7:10])
    return values


def in_ego(
    labels: NDArray[np.float64], to_ego: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return columns of `GEOMETRY` from height, width, length, x, y, z, rotation_y; shapes (B, 7).

    `to_ego` (B, 3, 4) may be tilted: centre and heading are turned as vectors, and the box is set
    upright about its centre."""
    height, width, length, x, y, z, rotation_y = labels.T
    centre = np.stack([x, y - 0.5 * height, z, np.ones_like(x)], axis=1)
    heading = np.stack([np.cos(rotation_y), np.zeros_like(x), -np.sin(rotation_y)], axis=1)
    moved = np.einsum("bij,bj->bi", to_ego, centre)
    ahead = np.einsum("bij,bj->bi", to_ego[:, :, :3], heading)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    return dict(zip(GEOMETRY, (*moved.T, length, width, height, yaw), strict=True))
