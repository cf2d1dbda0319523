"""Which column of a label file is what, by its name, else its values; the class of a category."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import SIZE
from lidarplace.scenes.label_tables.units import RADIANS, guess_angle, plain, without_unit

ALIKE = 0.8
"""Names less alike than this share of their letters are not taken for each other."""


_NAMES = read_yaml_file(Path(__file__).with_name("names.yaml"))
USUAL: Mapping[str, str] = _NAMES["usual"]
"""Key of the mapping -> names that it has in label files."""
_STEM = re.compile("|".join(f"(?P<{word}>{stems})" for word, stems in _NAMES["stems"].items()))
"""Of German and French words, in groups called by the English one."""


def class_in(category: str) -> str | None:
    """The class that the name of a category implies."""
    found = (c for c, told in _NAMES["classes"].items() if re.search(told, category, re.IGNORECASE))
    return next(found, None)


def _in_english(name: str) -> str:
    """A plain name with the words for which there are stems: `objektklasse` is `object_class`."""
    words = [[str(m.lastgroup) for m in _STEM.finditer(word)] or [word] for word in name.split("_")]
    return "_".join(part for parts in words for part in parts)


def guess_columns(columns: Sequence[str]) -> dict[str, str]:
    """A column for each key of `USUAL` that has one, so that names are most alike altogether."""
    likeness = np.array([[_likeness(name, usual) for name in columns] for usual in USUAL.values()])
    likeness = np.where(likeness < ALIKE, 0.0, likeness)
    keys = list(USUAL)
    pairs = zip(*linear_sum_assignment(-likeness), strict=True)
    return {keys[i]: columns[j] for i, j in pairs if likeness[i, j] > 0}


def _likeness(name: str, usual: str) -> float:
    """1 for a usual name, a little less for a later one."""
    own = {plain(name), without_unit(name), _in_english(without_unit(name))}
    own |= {re.sub("^(object|obj|box)_|_(object|obj|box)$", "", mine) for mine in own}
    return max(
        SequenceMatcher(None, mine, other).ratio() - 0.001 * place
        for mine in own
        for place, other in enumerate(usual.split())
    )


LEAST_STAMPS = 5
MOST_CATEGORIES = 50
SIDES = (1.5, 6.0)
"""Longest by shortest side of the median car."""
FLAT = 3.0
"""So many times wider than high is where the boxes are."""
TURNS = (math.pi, 2 * math.pi, 180.0, 360.0)
NEAR_TURN = 0.2
"""By this share an angle may end off one of `TURNS`."""


def add_columns_by_values(table: pd.DataFrame, columns: dict[str, str]) -> None:
    """Add columns to `columns`, by key, for the keys that no name identified.

    x, y and z, and the sizes, are looked for in columns side by side.
    """
    names = [str(name) for name in table]
    numbers = {name: pd.to_numeric(table[name], errors="coerce") for name in names}
    numbers = {name: values for name, values in numbers.items() if values.notna().all()}

    def left(among: Sequence[str]) -> list[str]:
        return [name for name in among if name not in columns.values()]

    def first(key: str, found: Iterator[str]) -> None:
        if key not in columns and (name := next(found, None)) is not None:
            columns[key] = name

    texts = [name for name in names if name not in numbers]
    first("category", (name for name in left(texts) if _names_classes(table[name])))
    first("drive", (name for name in left(texts) if _in_blocks(table[name])))
    drive = table[columns["drive"]] if "drive" in columns else pd.Series("", table.index)
    if not {"time", "frame"} & columns.keys():
        even = [name for name in left(list(numbers)) if _is_even(numbers[name], drive)]
        step = {name: np.diff(np.unique(numbers[name])).min() for name in even}
        first("time", (name for name in even if step[name] != 1 or numbers[name].max() > 1e8))
        if "time" not in columns:
            first("frame", iter(even))
    stamp = columns.get("time", columns.get("frame"))
    if stamp is None:
        return
    several = table.groupby([drive, table[stamp]])
    whole = [name for name, values in numbers.items() if (values % 1 == 0).all()]
    tracks = (
        name
        for name in left([*texts, *whole])
        if table[name].nunique() < len(table)
        and not table.duplicated([name, stamp] + [columns["drive"]] * ("drive" in columns)).any()
    )
    first("object", tracks)
    of_frame = [n for n in left(list(numbers)) if (several[n].nunique() == 1).all()]
    if several.ngroups == len(table):
        of_frame = []

    def triples() -> list[list[str]]:
        threes = [names[i : i + 3] for i in range(len(names) - 2)]
        own = numbers.keys() - of_frame
        return [three for three in threes if own.issuperset(three) and left(three) == three]

    if not set(SIZE) & columns.keys() and "category" in columns:
        kind = table[columns["category"]].map(lambda name: class_in(str(name)))
        columns |= _sizes(pd.DataFrame(numbers), kind, triples())
    if not {"x", "y", "z"} & columns.keys():
        spread = {name: values.std() for name, values in numbers.items()}
        wide = {min(spread[x], spread[y]): [x, y, z] for x, y, z in triples()}
        wide = {least: names for least, names in wide.items() if FLAT * spread[names[2]] < least}
        columns |= dict(zip("xyz", wide[max(wide)] if wide else [], strict=False))
    ends = {n: np.abs(numbers[n]).max() for n in left(list(numbers)) if n not in of_frame}
    off = {name: min(abs(end / turn - 1) for turn in TURNS) for name, end in ends.items()}
    first("yaw", (name for name in off if off[name] == min(off.values()) < NEAR_TURN))
    if {"x", "y"} <= columns.keys() and not any(key.startswith("poses.") for key in columns):
        places = table[[columns["x"], columns["y"]]].apply(pd.to_numeric, errors="coerce")
        of_rows = pd.DataFrame(numbers)[of_frame]
        columns |= _poses(places.to_numpy(np.float64), of_rows, several[of_frame].first())


def _names_classes(values: pd.Series) -> bool:
    named = values.dropna().astype(str).unique()
    return len(named) <= MOST_CATEGORIES and any(class_in(name) for name in named)


def _in_blocks(values: pd.Series) -> bool:
    """Whether a few names follow each other, each in one run of rows."""
    changes = int((values != values.shift()).sum())
    return 1 < changes == values.nunique() < len(values) / 2


def _is_even(values: pd.Series, drive: pd.Series) -> bool:
    """Whether values rise through each drive in steps of one size, several rows a step."""
    stamps = [np.unique(own) for _, own in values.groupby(drive)]
    steps = np.concatenate([np.diff(own) for own in stamps])
    rising = all(own.is_monotonic_increasing for _, own in values.groupby(drive))
    if not rising or len(steps) < LEAST_STAMPS - 1 or sum(map(len, stamps)) > len(values) / 1.5:
        return False
    shares = steps / np.median(steps)
    return bool((np.abs(shares - shares.round()) < 0.25).mean() > 0.8)


def _sizes(numbers: pd.DataFrame, kind: pd.Series, triples: list[list[str]]) -> dict[str, str]:
    """Three columns that are as long, wide and high as cars, and longer than people.

    Height is the longest side of pedestrians, length that of cars.
    """
    cars, people = (numbers[kind == name].median() for name in ("Car", "Pedestrian"))
    best, found = np.inf, dict[str, str]()
    for names in triples:
        if (numbers[names] <= 0).any(axis=None) or cars[names].isna().any():
            continue
        length = max(names, key=cars.__getitem__)
        ratio = float(cars[length]) / float(cars[names].min())
        longer = not cars[length] < SIDES[0] * people[names].max()  # NaN: there are no people
        if SIDES[0] <= ratio <= SIDES[1] and ratio < best and longer:
            rest = [name for name in names if name != length]
            if people[rest[0]] > people[rest[1]]:
                rest.reverse()
            best, found = ratio, dict(zip(SIZE, [length, *rest], strict=True))
    return found


def _poses(
    places: NDArray[np.float64], of_rows: pd.DataFrame, of_frames: pd.DataFrame
) -> dict[str, str]:
    """Two columns side by side that places of the world are close to, and a heading that fits."""
    pairs = [list(map(str, pair)) for pair in pairwise(of_rows.columns)]
    apart = [_distance(places - of_rows[pair].to_numpy(np.float64)) for pair in pairs]
    if not apart or min(apart) > 0.5 * _distance(places):
        return {}
    x, y = pairs[int(np.argmin(apart))]
    step_x, step_y = of_frames.groupby(level=0)[[x, y]].diff().to_numpy(np.float64).T
    for name in map(str, of_frames.columns.drop([x, y])):
        yaw = of_frames[name].to_numpy(np.float64)
        yaw = yaw * RADIANS[guess_angle(name, yaw).unit]
        if np.nanmedian(np.cos(yaw - np.arctan2(step_y, step_x))) > 0.9:
            return {"poses.x": x, "poses.y": y, "poses.yaw": name}
    return {}


def _distance(places: NDArray[np.float64]) -> float:
    return float(np.nanmedian(np.hypot(*places.T)))
