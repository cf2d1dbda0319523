"""Detections of any detector, as the log has its boxes: ego frame, metres, radians, its classes."""

from __future__ import annotations

from collections import ChainMap, Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet as pq

from lidarplace.base.class_names import IGNORE
from lidarplace.base.errors import InputError
from lidarplace.detections.frames import LogFrames
from lidarplace.detections.layouts import (
    Found,
    of_argoverse,
    of_kitti,
    of_nuscenes,
    of_parquet,
    of_waymo,
)
from lidarplace.files.atomic import first_line, reading
from lidarplace.files.regular import regular
from lidarplace.files.tables import read_parquet
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, SIZE
from lidarplace.logs.plausible import MOST_YAW
from lidarplace.scenes.datasets.class_maps import (
    ARGOVERSE,
    BOX_LOG,
    NUSCENES,
    WAYMO,
    ClassMap,
    classify,
    merged,
)
from lidarplace.scenes.datasets.waymo import SEGMENT
from lidarplace.scenes.kitti.calibration import LIDAR_HEIGHT_M
from lidarplace.scenes.kitti.read import KITTI

Layout = Literal["kitti", "nuscenes", "argoverse", "waymo", "parquet"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
COLUMNS = ("frame", "class", *GEOMETRY, "score")
_TYPES = {"frame": np.int64, "class": object} | dict.fromkeys((*GEOMETRY, "score"), np.float64)

_SUFFIXES: dict[str, Layout] = {
    ".txt": "kitti",
    ".json": "nuscenes",
    ".feather": "argoverse",
    ".parquet": "parquet",
}
_MAPS: dict[Layout, ClassMap] = {
    "kitti": KITTI,
    "nuscenes": NUSCENES,
    "argoverse": ARGOVERSE,
    "waymo": WAYMO,
    "parquet": BOX_LOG,
}
_PICKLES = {
    ".pkl": "pickle.load(open('{}', 'rb'))",
    ".pickle": "pickle.load(open('{}', 'rb'))",
    ".pt": "torch.load('{}', weights_only=False)",
    ".pth": "torch.load('{}', weights_only=False)",
}
_CONVERT = (
    'python -c "import pandas as pd, {module}; '
    "pd.concat([pd.DataFrame(d['boxes_lidar'][:, :7], columns=[*'xyz', 'length', 'width', "
    "'height', 'yaw']).assign(**{{'source': d['frame_id'], 'class': d['name'], 'score': "
    "d['score']}}) for d in {load}]).eval('z = z + {height}').to_parquet('{out}')\""
)
"""For the list of dictionaries that OpenPCDet writes: its boxes are in the LiDAR's frame."""


def read_detections(
    paths: Sequence[Path],
    log: BoxLog,
    classes: Sequence[str],
    *,
    layout: Layout | None = None,
    world: bool = False,
    calibration: Path | None = None,
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
) -> pd.DataFrame:
    """What a detector found in frames of `log`.

    Args:
        paths: files, or folders of them.
        log: names the frames, and poses the vehicle for boxes in the world.
        classes: of the log. A category is the class of that name, or that of the data set's class
            map.
        layout: None: by the names of files, and by the columns of Parquet.
        world: boxes of layout `parquet` are in the world, not in the ego frame.
        calibration: folder of KITTI's `calib` files for layout `kitti`; None: the camera of
            `lidarplace export`.
        class_map: entries in place of the data set's class map.
        ignored: gets the number of detections of known categories without class in `classes`.

    Returns:
        `COLUMNS`, a row a detection, sorted by frame: ego frame, metres, radians.

    Raises:
        InputError: a file is no such file; or a frame or category is unknown, a number is missing
            or not finite, a size is not above 0: names file and row.
    """
    files = [(file, _layout(file, layout)) for path in paths for file in _files(path)]
    counter = Counter[str]() if ignored is None else ignored
    every = {name for _, name in files}
    if world and every != {"parquet"}:
        raise InputError("only plain Parquet can have boxes in the world", place="world")
    if calibration is not None and every != {"kitti"}:
        raise InputError("only KITTI's result files need a camera", place=str(calibration))
    frames = LogFrames(log.frames)
    maps: dict[str, ClassMap] = {}
    for name in every:
        known = merged(_MAPS[name], class_map)
        maps[name] = ChainMap({own: own for own in classes}, known)  # type: ignore[arg-type]
    tables = []
    try:
        if results := [file for file, name in files if name == "kitti"]:
            found = of_kitti(results, frames, maps["kitti"], counter, calibration, _height(log))
            tables.append(_checked(found, maps["kitti"], classes, counter))
        for file, name in files:
            if name != "kitti":
                found = _read(file, name, frames, world)
                tables.append(_checked(found, maps[name], classes, counter))
    except (ValueError, OSError) as error:  # of readers of files, which name file and row
        raise error if isinstance(error, InputError) else InputError(str(error)) from None
    return pd.concat(tables).sort_values("frame", kind="stable", ignore_index=True)


def _files(path: Path) -> list[Path]:
    """The file, or those of a folder that can be detections."""
    if not path.exists():
        raise InputError("no such file or folder", place=str(path))
    if not path.is_dir():
        return [path]
    own = sorted(file for file in path.iterdir() if file.suffix in (*_SUFFIXES, *_PICKLES))
    if not own:
        raise InputError("no detections", place=str(path), expected=f"files {', '.join(_SUFFIXES)}")
    return own


def _layout(path: Path, layout: Layout | None) -> Layout:
    """What to read a file as. Raises InputError for a pickle: it can run any code."""
    if (load := _PICKLES.get(path.suffix)) is not None:
        line = _CONVERT.format(
            module=load.partition(".")[0],
            load=load.format(path),
            height=LIDAR_HEIGHT_M,
            out=path.with_suffix(".parquet"),
        )
        raise InputError(
            "a pickle can run code, so none is read",
            place=str(path),
            fix=f"one of OpenPCDet becomes Parquet by: {line}",
        )
    if layout is not None:
        return layout
    if path.suffix not in _SUFFIXES:
        wanted = f"{', '.join(_SUFFIXES)}, or a layout by name"
        raise InputError("unknown layout", place=str(path), expected=wanted, found=path.suffix)
    found = _SUFFIXES[path.suffix]
    return "waymo" if found == "parquet" and SEGMENT in _columns(path) else found


def _columns(path: Path) -> list[str]:
    with reading(path), regular(path).open("rb") as file:
        try:
            return list(pq.read_schema(file).names)
        except pa.ArrowException as error:
            problem = f"is no Parquet file: {first_line(error)}"
            raise InputError(problem, place=str(path)) from None


def _height(log: BoxLog) -> float:
    """Of the LiDAR above the ground: that of a log of KITTI, or the usual one."""
    placements = (rig.placement for rig in log.rigs.values())
    heights = {own.mounts[0].z for own in placements if own.name == "kitti"}
    return heights.pop() if len(heights) == 1 else LIDAR_HEIGHT_M


def _read(file: Path, layout: Layout, frames: LogFrames, world: bool) -> Found:
    if layout == "nuscenes":
        return of_nuscenes(file, frames)
    if layout == "argoverse":
        return of_argoverse(file, frames)
    table = read_parquet(file).reset_index(drop=True)
    return (
        of_waymo(table, file, frames)
        if layout == "waymo"
        else of_parquet(table, file, frames, world)
    )


def _checked(
    found: Found, class_map: ClassMap, classes: Sequence[str], ignored: Counter[str]
) -> pd.DataFrame:
    """`COLUMNS` of the detections of `classes`. Raises InputError for what no box can be."""
    table = found.table
    if not len(table):
        return pd.DataFrame(columns=list(COLUMNS)).astype(_TYPES)
    values = table[[*GEOMETRY, "score"]].to_numpy(np.float64)
    for names, bad, expected in (
        ([*GEOMETRY, "score"], ~np.isfinite(values), "a finite number"),
        (SIZE, values[:, 3:6] <= 0, "more than 0 m"),
        (("yaw",), np.abs(values[:, 6:7]) > MOST_YAW, "radians, at most two turns"),
    ):
        if bad.any():
            at, column = np.argwhere(bad)[0].tolist()
            name = names[column]
            value = f"{table[name].iloc[at]:g}"
            raise InputError(
                "invalid value", place=found.row(at), key=name, expected=expected, found=value
            )
    of_class = classify(table["category"], class_map, found.row, ignored)
    kept = np.isin(of_class, list(classes))
    lost = table["category"][~kept & (of_class != IGNORE)]
    ignored.update(lost.tolist())
    return table.assign(**{"class": of_class})[kept][list(COLUMNS)].astype(_TYPES)
