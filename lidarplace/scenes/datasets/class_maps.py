"""Classes of the box log by category of a data set: the paper's grouping, or its own names.

In the paper's, Car is everything of a car's size: sedans, pickups, SUVs. Cyclist is its *Van and
Cyclist*: bicycles, motorcycles, box trucks and the like. What its towns do not have (buses,
trailers, construction machines, scooters) is ignored, and so is what is not a road user."""

import reprlib
from collections import ChainMap, Counter
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import IGNORE, check_class_name, is_class_name
from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import excerpt
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import BOX_COLUMNS, CLASSES, count_columns, first

ClassMap = Mapping[str, str]  # category -> class, or `IGNORE`
BOX_LOG: ClassMap = MappingProxyType({name: name for name in CLASSES})
"""Class map of a log that already has our classes."""
_SHIPPED = read_yaml_file(Path(__file__).with_name("class_maps.yaml"))
NUSCENES, ARGOVERSE, WAYMO, KITTI, PANDASET, NO_ROAD_USERS = (
    MappingProxyType(_SHIPPED[name])
    for name in ("nuscenes", "argoverse", "waymo", "kitti", "pandaset", "no_road_users")
)
"""Class maps of data sets, and what is ignored where all others keep their own names."""
PAPER_GROUPS: ClassMap = ChainMap(_SHIPPED["usual"], _SHIPPED["argoverse"], _SHIPPED["nuscenes"])
"""The paper's grouping of names that data sets have, and of usual ones."""
PAPER, OWN = "paper", "own"  # class maps that have a name
OTHER = "Other"
"""Class of ignored categories whose boxes are kept: they hide what is behind them, and count in no
other class."""
NO_OBSTACLES = ("DontCare", "EGO_VEHICLE", "vehicle.ego_trailer")
"""Ignored categories that hide nothing: parts of an image, and the vehicle with the LiDARs."""


class OwnNames(dict[str, str]):
    """Class map that keeps categories whose name can be a class; NO_ROAD_USERS are ignored."""

    def __missing__(self, category: str) -> str:
        return IGNORE if category in NO_ROAD_USERS else category

    def __contains__(self, category: object) -> bool:
        return is_class_name(category)


def merged(usual: ClassMap, class_map: ClassMap | None, keep_ignored: bool = False) -> ClassMap:
    """Merge the `usual` class map of a data set with the entries of `class_map`.

    With `keep_ignored` ignored categories are `OTHER`, but for `NO_OBSTACLES`. Raises ValueError if
    a category is not text, or a class not a name."""
    result = class_map if isinstance(class_map, OwnNames) else {**usual, **(class_map or {})}
    check_class_map(result)
    if not keep_ignored:
        return result
    names = {*NO_ROAD_USERS, *result}.difference(NO_OBSTACLES)
    ignored = [name for name in names if name in result and result[name] == IGNORE]
    return ChainMap(dict.fromkeys(ignored, OTHER), result)


def named_class_map(name: str) -> ClassMap | None:
    """Return a class map: None for "paper", `OwnNames` for "own", else that of a YAML file.

    Raises OSError if the file cannot be read, ValueError if it is not YAML, or not a class map."""
    if name in (PAPER, OWN):
        return None if name == PAPER else OwnNames()
    content = read_yaml_file(path := Path(name))
    if not isinstance(content, dict):
        raise InputError(place=path, expected="lines `category: class`", found=excerpt(content))
    check_class_map(content, str(path))
    return content


def check_class_map(class_map: ClassMap, source: str = "class map") -> None:
    """Raise ValueError that names the entry, unless categories are text and classes are names."""
    for category, name in class_map.items():
        if not isinstance(category, str):
            raise InputError(place=source, expected="categories of text", found=excerpt(category))
        if name != IGNORE:
            check_class_name(name, place=source, key=category, fix=f"{IGNORE} leaves its boxes out")


def classify(
    categories: pd.Series,
    class_map: ClassMap,
    row: Callable[[int], str],
    ignored: Counter[str] | None,
) -> NDArray[np.object_]:
    """Return the class of every row of `categories`, or `IGNORE`; shape (rows,), text.

    Adds to `ignored` how many rows of each ignored category there are. Raises ValueError if a row
    has no category, or one not in `class_map`; `row` names the row."""
    values = categories.astype(object)
    if (index := first(values.isna())) is not None:
        raise InputError("missing category", place=row(index))
    if (index := first(values.map(lambda value: not isinstance(value, Hashable)))) is not None:
        text = reprlib.repr(values.iloc[index])
        raise InputError(place=row(index), expected="a category of text", found=text)
    codes, names = pd.factorize(values)
    for code, name in enumerate(names):
        if name not in class_map:
            fix, text = f"name its class in a class map, or {IGNORE}", reprlib.repr(name)
            place = row(int(np.argmax(codes == code)))
            raise InputError("unknown category", place=place, found=text, fix=fix)
    classes = np.array([class_map[name] for name in names], dtype=object)[codes]
    if ignored is not None:
        ignored.update(values[classes == IGNORE].tolist())
    return classes


def classified(boxes: pd.DataFrame) -> pd.DataFrame:
    """Drop boxes to `IGNORE`, and sort the others of a log by frame.

    They have the columns of a log, and the counts that `boxes` has."""
    boxes = boxes[boxes["class"] != IGNORE].sort_values("frame", kind="stable", ignore_index=True)
    return boxes[[*BOX_COLUMNS, *count_columns(boxes)]]
