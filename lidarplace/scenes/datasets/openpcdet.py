"""Box logs from OpenPCDet's layout of custom data: points, labels and lists of frames.

https://github.com/open-mmlab/OpenPCDet/blob/master/docs/CUSTOM_DATASET_TUTORIAL.md describes it."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from lidarplace.base.class_names import IGNORE
from lidarplace.base.errors import InputError
from lidarplace.clouds.cloud_files import CloudFile
from lidarplace.files.atomic import read_text
from lidarplace.files.regular import files_in, is_there
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, GEOMETRY, SOURCE
from lidarplace.scenes.datasets.class_maps import (
    PAPER_GROUPS,
    ClassMap,
    classified,
    classify,
    merged,
)
from lidarplace.scenes.datasets.drives import in_frames

SETS = MappingProxyType({"train": "train", "val": "test"})
"""List in `ImageSets` -> split of the box log."""
CLASSES: ClassMap = MappingProxyType(
    {
        **PAPER_GROUPS,
        "Vehicle": "Car",
        "Car": "Car",
        "Cyclist": "Cyclist",
        "Pedestrian": "Pedestrian",
        "DontCare": IGNORE,
    }
)
FIELDS = 8  # of a line: x y z dx dy dz heading category


def read_openpcdet(
    folder: Path,
    ignored: Counter[str],
    *,
    class_map: ClassMap | None = None,
    keep_ignored: bool = False,
    origin: Sequence[float] | None = None,
) -> BoxLog:
    """OpenPCDet's custom layout: points, labels and ImageSets; val becomes test.

    Axes, sizes and yaw are ours. Frames are those of `ImageSets/train.txt` and `val.txt`, or all
    files of `labels` without these lists; a split is one route. There are no times and no tracks.

    `origin` is that of the points and boxes in our ego frame, metres; None: ours. Raises OSError
    without labels, and ValueError that names file and line for what is wrong."""
    classes = merged(CLASSES, class_map, keep_ignored)
    names, splits = _frames(folder)
    rows: list[list[float]] = []
    of_box: list[tuple[int, str, str]] = []  # frame, category and place
    for frame, name in enumerate(names):
        path = folder / "labels" / f"{name}.txt"
        for line, (values, category) in _labels(path):
            rows.append(values)
            of_box.append((frame, category, f"{path}: line {line}"))
    shift = np.zeros(3) if origin is None else np.asarray(origin, np.float64)
    to_ego = np.column_stack([np.eye(3), shift])
    frames = pd.DataFrame(
        {
            "scene": folder.resolve().name or "log",
            "frame": np.arange(len(names)),
            "timestamp_s": np.nan,
            "route": [[*SETS.values()].index(split) for split in splits],
            "split": splits,
            CLOUD: [(CloudFile(f"points/{name}.npy", to_ego),) for name in names],
            SOURCE: names,
        }
    )
    boxes = np.array(rows, np.float64).reshape(-1, len(GEOMETRY))
    boxes[:, :3] += shift
    categories = pd.Series([category for _, category, _ in of_box], dtype=object)
    columns = {
        "object_id": [place.removeprefix(f"{folder}/") for _, _, place in of_box],
        "class": classify(categories, classes, lambda row: of_box[row][2], ignored),
        **dict(zip(GEOMETRY, boxes.T, strict=True)),
    }
    of_frame = np.array([frame for frame, _, _ in of_box], np.int64)
    return BoxLog(classified(in_frames(frames, of_frame, columns)), frames)


def _frames(folder: Path) -> tuple[list[str], list[str]]:
    """Return names and splits of the frames, in the order of the lists."""
    labels = {path.stem for path in files_in(folder / "labels") if path.suffix == ".txt"}
    lists = {name: folder / "ImageSets" / f"{name}.txt" for name in SETS}
    split_of: dict[str, str] = {}
    for name, path in lists.items():
        if not is_there(path):
            continue
        for number, frame in enumerate(map(str.strip, read_text(path).splitlines()), 1):
            place = f"{path}: line {number}"
            if frame in split_of:
                raise InputError(f"duplicate frame {frame}", place=place)
            if frame and frame not in labels:
                raise InputError(f"no file {folder / 'labels' / frame}.txt", place=place)
            if frame:
                split_of[frame] = SETS[name]
    if not any(map(is_there, lists.values())):
        split_of = dict.fromkeys(sorted(labels), "train")
    if not split_of:
        raise InputError(place=folder, expected="files in labels, listed in ImageSets")
    return list(split_of), list(split_of.values())


def _labels(path: Path) -> Iterator[tuple[int, tuple[list[float], str]]]:
    """Yield the boxes of a file by line: numbers of `GEOMETRY`, and the category."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not (fields := line.split()):
            continue
        place = f"{path}: line {number}"
        if len(fields) != FIELDS:
            expected = f"{FIELDS} fields: x y z dx dy dz heading category"
            raise InputError(place=place, expected=expected, found=len(fields))
        try:
            values = [float(field) for field in fields[:-1]]
        except ValueError:
            values = [np.nan]
        if not np.isfinite(values).all():
            raise InputError(place=place, expected="finite numbers", found=repr(line))
        if min(values[3:6]) < 0:
            raise InputError(place=place, expected="sizes >= 0", found=values[3:6])
        yield number, (values, fields[-1])
