"""Which category of a data set is which class of the box log: the paper's grouping, or its own.

In the paper's grouping Car is what is of a car's size: sedans, pickups, SUVs. Cyclist is its *Van
and Cyclist*: bicycles, motorcycles, box trucks and what is like them. What its towns do not have
(buses, trailers, construction machines, scooters) is ignored, and so is what is no road user.
"""

import reprlib
from collections import ChainMap, Counter
from collections.abc import Callable, Hashable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import IGNORE, fault_of_name
from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import found
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import CLASSES

ClassMap = Mapping[str, str]
"""Category -> class, or `IGNORE`."""


def _by_class(**categories: str) -> ClassMap:
    """A class map from the categories of each class, separated by spaces."""
    return MappingProxyType({one: name for name, own in categories.items() for one in own.split()})


BOX_LOG: ClassMap = MappingProxyType({name: name for name in CLASSES})
"""A log that already has our classes."""

NUSCENES = _by_class(
    Car="vehicle.car vehicle.emergency.police",
    # Trucks are pickups, too: nuScenes does not distinguish them.
    Cyclist="vehicle.bicycle vehicle.emergency.ambulance vehicle.motorcycle vehicle.truck",
    Pedestrian=(
        "human.pedestrian.adult human.pedestrian.child human.pedestrian.construction_worker "
        "human.pedestrian.police_officer"
    ),
    ignore=(
        "animal human.pedestrian.personal_mobility human.pedestrian.stroller "
        "human.pedestrian.wheelchair movable_object.barrier movable_object.debris "
        "movable_object.pushable_pullable movable_object.trafficcone static_object.bicycle_rack "
        "vehicle.bus.bendy vehicle.bus.rigid vehicle.construction vehicle.trailer"
    ),
)
"""The 23 categories of nuScenes v1.0."""

ARGOVERSE = _by_class(
    Car="REGULAR_VEHICLE",
    Cyclist="BICYCLE BICYCLIST BOX_TRUCK LARGE_VEHICLE MOTORCYCLE MOTORCYCLIST TRUCK TRUCK_CAB",
    Pedestrian="OFFICIAL_SIGNALER PEDESTRIAN",
    # EGO_VEHICLE has the sensors; the guide calls MOBILE_PEDESTRIAN_SIGN the other way.
    ignore=(
        "ANIMAL ARTICULATED_BUS BOLLARD BUS CONSTRUCTION_BARREL CONSTRUCTION_CONE DOG EGO_VEHICLE "
        "MESSAGE_BOARD_TRAILER MOBILE_PEDESTRIAN_CROSSING_SIGN MOBILE_PEDESTRIAN_SIGN "
        "RAILED_VEHICLE SCHOOL_BUS SIGN STOP_SIGN STROLLER TRAFFIC_LIGHT_TRAILER VEHICULAR_TRAILER "
        "WHEELCHAIR WHEELED_DEVICE WHEELED_RIDER"
    ),
)
"""The 30 categories of the Argoverse 2 sensor data set, one under two names, and the ego itself."""

WAYMO: ClassMap = MappingProxyType(
    {
        "TYPE_UNKNOWN": IGNORE,
        "TYPE_VEHICLE": "Car",  # trucks, buses and motorcycles too: Waymo does not tell them apart
        "TYPE_PEDESTRIAN": "Pedestrian",
        "TYPE_SIGN": IGNORE,
        "TYPE_CYCLIST": "Cyclist",
    }
)
"""The types of Waymo's 3D boxes, in the order of their numbers."""


NO_ROAD_USERS = _by_class(
    ignore=(
        "ANIMAL BOLLARD CONSTRUCTION_BARREL CONSTRUCTION_CONE DOG DontCare EGO_VEHICLE "
        "MOBILE_PEDESTRIAN_CROSSING_SIGN MOBILE_PEDESTRIAN_SIGN Misc SIGN STOP_SIGN TYPE_SIGN "
        "TYPE_UNKNOWN animal movable_object.barrier movable_object.debris "
        "movable_object.pushable_pullable movable_object.trafficcone static_object.bicycle_rack"
    )
)
"""Categories that are ignored where all others keep their own names."""


PAPER_GROUPS: ClassMap = MappingProxyType(
    {
        **NUSCENES,
        **ARGOVERSE,
        "Bicycle": "Cyclist",
        "Motorcycle": "Cyclist",
        "Truck": "Cyclist",
        "Van": "Car",
    }
)
"""The paper's grouping of names that data sets have, and of usual ones."""

PAPER, OWN = "paper", "own"
"""Class maps that have a name."""


OTHER = "Other"
"""Class of ignored categories whose boxes are kept: they hide what is behind them, and count in no
other class."""
NO_OBSTACLES = ("DontCare", "EGO_VEHICLE")
"""Ignored categories that hide nothing: parts of an image, and the vehicle with the LiDARs."""


class OwnNames(Mapping[str, str]):
    """Every category whose name can be one of a class keeps it; what is no road user is ignored."""

    def __getitem__(self, category: str) -> str:
        return IGNORE if category in NO_ROAD_USERS else category

    def __contains__(self, category: object) -> bool:
        return fault_of_name(category) is None

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


def merged(known: ClassMap, class_map: ClassMap | None, keep_ignored: bool = False) -> ClassMap:
    """The class map of a data set, `known`, with what `class_map` says in its place.

    Args:
        keep_ignored: ignored categories are `OTHER`, but for `NO_OBSTACLES`.

    Raises:
        ValueError: a category is no text, or a class no name.
    """
    if isinstance(class_map, OwnNames):
        result: ClassMap = class_map
    else:
        result = {**known, **(class_map or {})}
        check_class_map(result)
    if not keep_ignored:
        return result
    names = {*NO_ROAD_USERS, *result}.difference(NO_OBSTACLES)
    ignored = [name for name in names if name in result and result[name] == IGNORE]
    return ChainMap(dict.fromkeys(ignored, OTHER), result)  # type: ignore[arg-type]


def named_class_map(name: str) -> ClassMap | None:
    """What a user calls a class map: "paper" is None, "own" `OwnNames`, else a YAML file's path.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no YAML, or no class map.
    """
    if name == PAPER:
        return None
    return OwnNames() if name == OWN else read_class_map(Path(name))


def read_class_map(path: Path) -> dict[str, str]:
    """A class map from a YAML file of lines `category: class`.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no YAML, or no class map.
    """
    content = read_yaml_file(path)
    if not isinstance(content, dict):
        raise ValueError(f"{path}: must have lines `category: class`, found {found(content)}")
    check_class_map(content, str(path))
    return content


def check_class_map(class_map: ClassMap, source: str = "class map") -> None:
    """Raise ValueError that names the entry, unless categories are text and classes are names."""
    for category, name in class_map.items():
        if not isinstance(category, str):
            raise ValueError(f"{source}: a category must be text, found {found(category)}")
        if name != IGNORE and (fault := fault_of_name(name)) is not None:
            raise ValueError(f"{source}: {category}: {fault}; {IGNORE} leaves its boxes out")


def classify(
    categories: pd.Series, class_map: ClassMap, row: Callable[[int], str], ignored: Counter[str]
) -> NDArray[np.object_]:
    """The class of every row of `categories`, or `IGNORE`; shape (rows,), text.

    Adds to `ignored` how many rows of each ignored category there are.

    Raises:
        ValueError: a row has no category, or one not in `class_map`; `row` names the row.
    """
    values = categories.astype(object)
    missing = values.isna().to_numpy(bool)
    if missing.any():
        raise InputError("the category is missing", place=row(int(np.argmax(missing))))
    hashable = values.map(lambda value: isinstance(value, Hashable)).to_numpy(bool)
    if not hashable.all():
        index = int(np.argmin(hashable))
        found = reprlib.repr(values.iloc[index])
        raise InputError(f"the category must be text, found {found}", place=row(index))
    codes, names = pd.factorize(values)
    for code, name in enumerate(names):
        if name not in class_map:
            raise InputError(
                f"unknown category {reprlib.repr(name)}",
                place=row(int(np.argmax(codes == code))),
                fix=f"name its class in a class map, or {IGNORE}",
            )
    classes = np.array([class_map[name] for name in names], dtype=object)
    counts = np.bincount(codes, minlength=len(names)).tolist()
    for name, count, object_class in zip(names, counts, classes, strict=True):
        if object_class == IGNORE:
            ignored[name] += count
    return classes[codes]
