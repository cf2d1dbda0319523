"""Detections of any detector, as the log has its boxes: ego frame, metres, radians, its classes."""

from collections import ChainMap, Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pandas as pd

from lidarplace.base.class_names import IGNORE
from lidarplace.base.errors import InputError, at
from lidarplace.detections import layouts
from lidarplace.detections.layouts import DetectionTable, LogFrames
from lidarplace.files.regular import files_in
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.logs.plausibility import check_unit, first_invalid
from lidarplace.scenes.datasets.class_maps import KITTI, ClassMap, classify, merged
from lidarplace.scenes.kitti.calibration import LIDAR_HEIGHT_M

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
_PICKLES = {
    **dict.fromkeys((".pkl", ".pickle"), "pickle.load(open('{}', 'rb'))"),
    **dict.fromkeys((".pt", ".pth"), "torch.load('{}', weights_only=False)"),
}
_CONVERT = (
    'python -c "import pandas as pd, {module}; '
    "pd.concat([pd.DataFrame(d['boxes_lidar'][:, :7], columns=[*'xyz', 'length', 'width', "
    "'height', 'yaw']).assign(**{{'source': d['frame_id'], 'class': d['name'], 'score': "
    "d['score']}}) for d in {load}]).eval('z = z + {height}').to_parquet('{out}')\""
)
"""Conversion of OpenPCDet's list of dictionaries, whose boxes are in the LiDAR's frame."""


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
    """Read what a detector predicted in frames of `log`: `COLUMNS`, by frame, in the ego frame.

    Args:
        paths: files, or folders of them.
        log: names the frames, and poses the vehicle for boxes in the world.
        classes: of the log. A category is the class of that name, or that of the class map.
        layout: None: by the names of files, and by the columns of Parquet.
        world: boxes of layout `parquet` are in the world, not in the ego frame.
        calibration: folder of KITTI's `calib` files; None: the camera of `lidarplace export`.
        class_map: entries in place of the data set's class map.
        ignored: gets the number of detections of known categories without class in `classes`.

    Raises:
        InputError: a file has another format, a frame or category is unknown, or a number
            is invalid.
    """
    files = [(file, layout or _layout(file)) for path in paths for file in _files(path)]
    counter = Counter[str]() if ignored is None else ignored
    layouts_of_files = {name for _, name in files}
    if world and layouts_of_files != {"parquet"}:
        raise InputError("only plain Parquet can have boxes in the world", place="world")
    if calibration is not None and layouts_of_files != {"kitti"}:
        raise InputError("only KITTI's result files need a camera", place=calibration)
    try:
        frames, parts = LogFrames(log.frames), []
        if results := [file for file, name in files if name == "kitti"]:
            camera = calibration, _height(log)
            types = _with(classes, KITTI, class_map)
            parts.append(layouts.of_kitti(results, frames, types, counter, *camera))
        for file, name in files:
            if name == "nuscenes":
                parts.append(layouts.of_nuscenes(file, frames))
            elif name == "argoverse":
                parts.append(layouts.of_argoverse(file, frames))
            elif name != "kitti":
                as_waymo = None if layout is None else layout == "waymo"
                parts.append(layouts.of_parquet(file, frames, as_waymo, world))
        tables = [_checked(part, classes, class_map, counter) for part in parts]
    except (ValueError, OSError) as error:  # of readers of files, which name file and row
        raise error if isinstance(error, InputError) else InputError(str(error)) from None
    return pd.concat(tables).sort_values("frame", kind="stable", ignore_index=True)


def _with(classes: Sequence[str], usual: ClassMap, class_map: ClassMap | None) -> ClassMap:
    """Add the classes of a log as categories of a class map."""
    categories = {name: name for name in classes}
    return ChainMap(categories, merged(usual, class_map))  # type: ignore[arg-type]


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError("no such file or folder", place=path)
    files = [path]
    if path.is_dir():
        files = [file for file in files_in(path) if file.suffix in {**_SUFFIXES, **_PICKLES}]
    if not files:
        raise InputError("no detections", place=path, expected=f"files {', '.join(_SUFFIXES)}")
    for file in files:
        if (load := _PICKLES.get(file.suffix)) is not None:
            names = {"module": load.partition(".")[0], "load": load.format(file)}
            line = _CONVERT.format(**names, height=LIDAR_HEIGHT_M, out=file.with_suffix(".parquet"))
            fix = f"one of OpenPCDet becomes Parquet by: {line}"
            raise InputError("a pickle can run code, so none is read", place=file, fix=fix)
    return files


def _layout(path: Path) -> Layout:
    if path.suffix not in _SUFFIXES:
        expected = ", ".join(_SUFFIXES)
        raise InputError("unknown layout", place=path, expected=expected, found=path.suffix)
    return _SUFFIXES[path.suffix]


def _height(log: BoxLog) -> float:
    """Return the height of the LiDAR above the ground: that of a log of KITTI, or the usual one."""
    placements = (rig.placement for rig in log.rigs.values())
    heights = {rig.mounts[0].z for rig in placements if rig.name == "kitti"}
    return heights.pop() if len(heights) == 1 else LIDAR_HEIGHT_M


def _checked(
    detections: DetectionTable,
    classes: Sequence[str],
    class_map: ClassMap | None,
    ignored: Counter[str],
) -> pd.DataFrame:
    """Validate detections, and select `COLUMNS` of those of `classes`; raise InputError."""
    table = detections.table
    if not len(table):
        return pd.DataFrame(columns=list(COLUMNS)).astype(_TYPES)
    values = table[[*GEOMETRY, "score"]].to_numpy(np.float64)
    if (invalid := first_invalid(values)) is not None:
        row, key, expected = invalid
        where = {"place": detections.row(row), "key": key}
        value = f"{table[key].iloc[row]:g}"
        raise InputError("invalid value", **where, expected=expected, found=value)
    with at(detections.row(0)):
        check_unit(values[:, 3:6])
    types = _with(classes, detections.class_map, class_map)
    class_of = classify(table["category"], types, detections.row, ignored)
    in_classes = np.isin(class_of, list(classes))
    ignored.update(table["category"][~in_classes & (class_of != IGNORE)].tolist())
    return table.assign(**{"class": class_of})[in_classes][list(COLUMNS)].astype(_TYPES)
