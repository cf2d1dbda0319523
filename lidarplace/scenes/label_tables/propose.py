"""A first guess of the mapping of a label file: columns by their names, units by their values."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausibility import SIZES
from lidarplace.scenes.datasets.tabular import read_table
from lidarplace.scenes.label_tables import units
from lidarplace.scenes.label_tables.mapping import Columns

ALIKE = 0.8  # names less alike than this share of their letters are not taken for each other
_NAMES = read_yaml_file(Path(__file__).with_name("names.yaml"))
USUAL: Mapping[str, str] = _NAMES["usual"]  # key of the mapping -> names that it has in label files
_STEM = re.compile("|".join(f"(?P<{word}>{stems})" for word, stems in _NAMES["stems"].items()))
"""Stems of German and French words, in groups called by the English one."""
TEST_SHARE = 0.2
MOST_CATEGORIES = 200
NEAR_GROUND_M = 0.1


def propose_mapping(path: Path) -> str:
    """Propose a mapping of the label file as YAML, with the evidence of each guess as comments.

    A column that its name does not identify is a key without value, an error to who reads it.
    Raises ValueError if the file cannot be read, or has no rows."""
    table = read_table(path, ())
    if table.empty:
        raise InputError("no rows", place=path)
    table.columns = table.columns.map(str)
    columns = guess_columns(list(table.columns))
    if "time" in columns:
        columns.pop("frame", None)
    head = f"# A guess from names and values of {path.name}: check every line of it."
    return "\n".join([head, *_Proposal(table, columns).lines(), ""])


class _Proposal:
    """The parts of the mapping, which depend on each other's units."""

    def __init__(self, table: pd.DataFrame, columns: dict[str, str]) -> None:
        self.table, self.columns = table, columns
        x, y, z = (self._numbers(axis) for axis in "xyz")
        ego_x, ego_y, ego_z = (self._numbers(f"poses.{axis}") for axis in "xyz")
        relative = np.hypot(x - ego_x, y - ego_y)
        self.has_poses = {"poses.x", "poses.y", "poses.yaw"} <= columns.keys()
        self.in_world = self.has_poses and _median(relative) < 0.5 * _median(np.hypot(x, y))
        distance = _median(relative if self.in_world else np.hypot(x, y))
        longest = np.max([self._numbers(side) for side in SIZE], axis=0)
        x_name, length = columns.get("x", ""), columns.get("length", "")
        self.position = units.guess_length(x_name, distance, units.DISTANCES, "distance")
        self.size = units.guess_length(length, _median(longest), SIZES, "the longest side")
        self.z = z - np.nan_to_num(ego_z) if self.in_world else z

    def lines(self) -> Iterator[str]:
        """Yield the lines of the YAML document."""
        yield from self._columns()
        yield "units:"
        yield "  position: {}   # {}".format(*self.position)
        yield "  size: {}   # {}".format(*self.size)
        yield self._angle("yaw")
        frames = []
        if "time" in self.columns:
            latest, step = float(pd.Series(self._numbers("time")).max()), self._step()
            time = units.guess_time(self.columns["time"], latest, step)
            yield "  time: {}   # {}".format(*time)
            if (seconds := step * units.SECONDS[time.unit]) > 0:
                rate = f"  rate_hz: {_rate(seconds)}   # {seconds:.4g} s from time to time"
                frames = ["frames:", rate]
        yield from self._place()
        yield from self._classes()
        yield from frames
        yield from self._drives()

    def _numbers(self, key: str) -> NDArray[np.float64]:
        if key not in self.columns:
            return np.full(len(self.table), np.nan)
        numbers = pd.to_numeric(self.table[self.columns[key]], errors="coerce")
        return np.asarray(numbers.to_numpy(np.float64, na_value=np.nan))

    def _angle(self, key: str) -> str:
        angle = units.guess_angle(self.columns.get(key, ""), self._numbers(key))
        return "  angle: {}   # {}".format(*angle)

    def _step(self) -> float:
        """Return the median time between time stamps of a drive; NaN if there is one."""
        drive = self.columns.get("drive")
        stamps = pd.DataFrame({"time": self._numbers("time")})
        stamps["drive"] = self.table[drive].astype(str) if drive else ""
        stamps = stamps.drop_duplicates().sort_values(["drive", "time"])
        return float(stamps.groupby("drive")["time"].diff().median())

    def _columns(self) -> Iterator[str]:
        rest = [name for name in self.table.columns if name not in self.columns.values()]
        yield "columns:"
        for key, field in Columns.model_fields.items():
            if key in self.columns:
                yield f"  {key}: {_text(self.columns[key])}"
            elif field.is_required() or (key == "time" and "frame" not in self.columns):
                others = _text(", ".join(rest) or "none")
                yield f"  {key}:   # nothing tells it; other columns: {others}"

    def _place(self) -> Iterator[str]:
        height = self._numbers("height") * units.METRES[self.size.unit]
        z = self.z * units.METRES[self.position.unit]
        centre, bottom = (_median(low) for low in (z - height / 2, z))
        at_bottom = abs(bottom) < min(abs(centre), NEAR_GROUND_M)
        at, ground = ("bottom", bottom) if at_bottom else ("centre", centre)
        why = f"z is {bottom:.2f} m in the median, z less half the height {centre:.2f} m"
        yield f"box_z: {at}   # {why}"
        lift = 0.0 if not abs(ground) > NEAR_GROUND_M else -ground
        yield "origin:   # of the file's vehicle frame, seen from the ground under the centre"
        yield "  x: 0.0   # no value tells it; a rear axle is behind the centre: -1.4, say"
        yield f"  z: {lift:.2f}   # undersides of boxes are then on the ground in the median"
        if not self.has_poses:
            return
        yield f"coordinates: {'world' if self.in_world else 'ego'}   # by distance"
        yield "poses:"
        for key in ("x", "y", "z", "yaw"):
            if f"poses.{key}" in self.columns:
                yield f"  {key}: {_text(self.columns[f'poses.{key}'])}"
        yield f"  position: {self.position.unit}   # as of boxes"
        yield self._angle("poses.yaw")

    def _classes(self) -> Iterator[str]:
        yield "classes:   # Car, Cyclist, Pedestrian, any name (Truck), or null to leave it out"
        if "category" not in self.columns:
            return
        counts = self.table[self.columns["category"]].astype(str).value_counts()
        for name, count in counts.iloc[:MOST_CATEGORIES].items():
            class_name = _class_in(str(name)) or "null"
            share = percent(count / len(self.table), ".1f")
            yield f"  {_text(str(name))}: {class_name}   # {share}"

    def _drives(self) -> Iterator[str]:
        if "drive" not in self.columns:
            return
        names = sorted(self.table[self.columns["drive"]].dropna().astype(str).unique())
        test = names[len(names) - max(round(TEST_SHARE * len(names)), len(names) > 1) :]
        yield "drives:   # those that are not test are train"
        yield f"  test: [{', '.join(map(_text, test))}]"


def _class_in(category: str) -> str | None:
    for name, pattern in _NAMES["classes"].items():
        if re.search(pattern, category, re.IGNORECASE):
            return str(name)
    return None


def _in_english(name: str) -> str:
    """Translate the words of a plain name that have stems: `objektklasse` is `object_class`."""
    words = [[str(m.lastgroup) for m in _STEM.finditer(word)] or [word] for word in name.split("_")]
    return "_".join(part for parts in words for part in parts)


def guess_columns(columns: Sequence[str]) -> dict[str, str]:
    """Match columns with the keys of `USUAL`, so that names are most alike altogether."""
    likeness = np.array([[_likeness(name, usual) for name in columns] for usual in USUAL.values()])
    likeness = np.where(likeness < ALIKE, 0.0, likeness)
    keys = list(USUAL)
    pairs = zip(*linear_sum_assignment(-likeness), strict=True)
    return {keys[i]: columns[j] for i, j in pairs if likeness[i, j] > 0}


def _likeness(name: str, usual: str) -> float:
    """Compare names: 1 for a usual name, a little less for a later one."""
    forms = {units.plain(name), units.without_unit(name), _in_english(units.without_unit(name))}
    forms |= {re.sub("^(object|obj|box)_|_(object|obj|box)$", "", form) for form in forms}
    return max(
        SequenceMatcher(None, form, other).ratio() - 0.001 * place
        for form in forms
        for place, other in enumerate(usual.split())
    )


def _median(values: NDArray[np.float64]) -> float:
    """Return the median of the numbers among values; NaN if none is."""
    return float(pd.Series(values).median())


def _rate(step: float) -> float:
    """Return frames a second, a whole number where it is nearly one."""
    whole = round(rate := 1 / step)
    return float(whole) if whole and abs(rate - whole) < 0.02 * rate else float(f"{rate:.4g}")


def _text(name: str) -> str:
    """Write a text in YAML; quoted as JSON, which YAML reads."""
    return name if name.isidentifier() and name.lower() not in _WORDS else json.dumps(name)


_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
"""Texts that YAML takes for something else."""
