"""A first guess of the mapping of a label file: columns by their names, units by their values."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.configuration.yaml import parse_yaml, read_yaml_file
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausibility import SIZES
from lidarplace.rigs.rotations import MOST_OFF
from lidarplace.scenes.label_tables import units
from lidarplace.scenes.label_tables.evidence import anchor_line, convention_lines
from lidarplace.scenes.label_tables.files import read_label_file
from lidarplace.scenes.label_tables.frames import read_dates
from lidarplace.scenes.label_tables.mapping import TableMapping
from lidarplace.scenes.label_tables.read import read_labels
from lidarplace.scenes.label_tables.units import plain
from lidarplace.scenes.sanity_checks.boxes import SIDES_M
from lidarplace.scenes.sanity_checks.motion import CLEARLY

ALIKE = 0.8  # names less alike than this share of their letters are not taken for each other
_NAMES = read_yaml_file(Path(__file__).with_name("names.yaml"))
USUAL: Mapping[str, str] = _NAMES["usual"]  # key of the mapping -> names that it has in label files
_STEM = re.compile("|".join(f"(?P<{word}>{stems})" for word, stems in _NAMES["stems"].items()))
"""Stems of German and French words, in groups called by the English one."""
TEST_SHARE = 0.2
MOST_CATEGORIES = 200
NEAR_GROUND_M = 0.1
REQUIRED = ("category", "x", "y", "z", "length", "width", "height", "yaw")


def propose_mapping(path: Path) -> str:
    """Propose a mapping of the label file as YAML, with the evidence of each guess as comments.

    A column that its name does not identify is a key without value, an error to who reads it.
    Raises ValueError if the file cannot be read, or has no rows."""
    table = read_label_file(path, ())
    if table.empty:
        raise InputError("no rows", place=path)
    table.columns = table.columns.map(str)
    quaternions = _quaternions(table)
    columns = guess_columns([name for name in table.columns if name not in quaternions.values()])
    for key in [key for key in ("yaw", "poses.yaw") if f"{key[:-3]}quaternion.w" in quaternions]:
        columns.pop(key, None)
    columns |= quaternions
    if "time" in columns:
        columns.pop("frame", None)
    head = f"# A guess from names and values of {path.name}: check every line of it."
    proposal = _Proposal(table, columns)
    lines = [head, *proposal.lines(), ""]
    text = "\n".join(lines)
    try:
        mapping = TableMapping.model_validate(parse_yaml(text))
        log = read_labels(table, mapping, Counter(), path.name)
        lines[-1:] = [*convention_lines(log, mapping), ""]
        text = "\n".join(lines)
        mapping = TableMapping.model_validate(parse_yaml(text))
        log = read_labels(table, mapping, Counter(), path.name)
    except ValueError:  # an open key, or values that converting names
        return text
    anchor = anchor_line(log, mapping.anchor)
    return re.sub(r"(?m)^anchor: .*$", anchor, text) if anchor else text


def _quaternions(table: pd.DataFrame) -> dict[str, str]:
    """Return four columns in a row that are quaternions by their length, of boxes and of poses.

    Of the orders w, x, y, z and x, y, z, w the one in which objects are upright, unless named."""
    quaternions: dict[str, str] = {}
    names = list(table.columns)
    for four in zip(names, names[1:], names[2:], names[3:], strict=False):
        if not all(pd.api.types.is_numeric_dtype(table[name]) for name in four):
            continue
        values = table[list(four)].dropna(how="all").to_numpy(np.float64)
        off = np.abs(np.linalg.norm(values, axis=1) - 1)
        ends = "".join(plain(name)[-1] for name in four)
        if not len(values) or not (off <= MOST_OFF).all():
            continue
        if {*ends} == {*"wxyz"}:
            order = ends
        elif np.isin(values, (0, 1)).all() and ends != "0123":
            continue  # marks of four kinds
        else:
            tilt = [np.abs(values[:, columns_of]).sum() for columns_of in ([1, 2], [0, 1])]
            order = "wxyz" if tilt[0] < tilt[1] else "xyzw"
        of_poses = re.match("(ego|host|vehicle)(_|$)", plain(four[0]))
        start = "poses.quaternion" if of_poses else "quaternion"
        if f"{start}.w" not in quaternions:
            quaternions |= {f"{start}.{axis}": n for axis, n in zip(order, four, strict=True)}
    return quaternions


class _Proposal:
    """The parts of the mapping, which depend on each other's units."""

    def __init__(self, table: pd.DataFrame, columns: dict[str, str]) -> None:
        self.table, self.columns = table, columns
        self.dates: pd.Series | None = None
        if "time" in columns and not pd.api.types.is_numeric_dtype(table[columns["time"]]):
            dates = read_dates(table[columns["time"]])
            self.dates = dates if dates.notna().mean() > 0.5 else None
        x, y, z = (self._numbers(axis) for axis in "xyz")
        ego_x, ego_y, ego_z = (self._numbers(f"poses.{axis}") for axis in "xyz")
        relative = np.hypot(x - ego_x, y - ego_y)
        heading = "poses.yaw" in columns or "poses.quaternion.w" in columns
        self.has_poses = heading and {"poses.x", "poses.y"} <= columns.keys()
        self.in_world = self.has_poses and _median(relative) < 0.5 * _median(np.hypot(x, y))
        distance = _median(relative if self.in_world else np.hypot(x, y))
        longest = np.max([self._numbers(side) for side in SIZE], axis=0)
        x_name, length = columns.get("x", ""), columns.get("length", "")
        self.position = units.guess_length(x_name, distance, units.DISTANCES, "distance")
        self.size = units.guess_length(length, _median(longest), SIZES, "the longest side")
        self.z = z - np.nan_to_num(ego_z) if self.in_world else z
        self.half = _is_half(table, columns, units.METRES[self.size.unit])

    def lines(self) -> Iterator[str]:
        """Yield the lines of the YAML document."""
        yield from self._columns()
        yield "units:"
        yield "  position: {}   # {}".format(*self.position)
        yield "  size: {}   # {}".format(*self.size)
        if "yaw" in self.columns:
            yield self._angle("yaw")
        frames = []
        if "time" in self.columns:
            latest, step = float(pd.Series(self._numbers("time")).max()), self._step()
            time = units.Guess("iso", "dates of ISO 8601")
            if self.dates is None:
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
        if key == "time" and self.dates is not None:
            epoch = pd.Timestamp(0, tz="UTC")
            return np.asarray((self.dates - epoch) / pd.Timedelta("1us"), np.float64)
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
        for key in USUAL:
            if key.startswith("poses."):
                continue
            if key in self.columns:
                yield f"  {key}: {_text(self.columns[key])}"
            elif key == "yaw" and "quaternion.w" in self.columns:
                yield self._quaternion("quaternion")
            elif key in REQUIRED or (key == "time" and "frame" not in self.columns):
                others = _text(", ".join(rest) or "none")
                yield f"  {key}:   # write the name of a column here; other columns: {others}"

    def _place(self) -> Iterator[str]:
        if self.half:
            yield f"size: half   # {self.half}"
        height = self._numbers("height") * units.METRES[self.size.unit] * (2 if self.half else 1)
        z = self.z * units.METRES[self.position.unit]
        undersides = {"centre": z - height / 2, "bottom": z, "top": z - height}
        ground_of = {name: _median(low) for name, low in undersides.items()}
        spread = {name: _median(abs(low - ground_of[name])) for name, low in undersides.items()}
        at = min(spread, key=lambda name: spread[name])
        centre, bottom, _ = ground_of.values()
        if abs(bottom) < min(abs(centre), NEAR_GROUND_M):
            at = "bottom"
        elif abs(centre) < NEAR_GROUND_M or not spread[at] < spread["centre"] / CLEARLY:
            at = "centre"
        ground = ground_of[at]
        why = f"z is {bottom:.2f} m in the median, z less half the height {centre:.2f} m"
        yield f"anchor: {at}   # {why}"
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
        if "poses.quaternion.w" in self.columns:
            yield self._quaternion("poses.quaternion")
        yield f"  position: {self.position.unit}   # as of boxes"
        if "poses.yaw" in self.columns:
            yield self._angle("poses.yaw")

    def _quaternion(self, key: str) -> str:
        names = (f"{axis}: {_text(self.columns[f'{key}.{axis}'])}" for axis in "xyzw")
        return f"  quaternion: {{{', '.join(names)}}}   # of length 1"

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


def _is_half(table: pd.DataFrame, columns: Mapping[str, str], metres: float) -> str:
    """Return the evidence that sizes are half: cars that are possible twice as large alone."""
    names = [columns.get(key, "") for key in (*SIZE, "category")]
    if "" in names:
        return ""
    cars = table[names[3]].map(lambda name: _class_in(str(name))) == "Car"
    sizes = table.loc[cars, names[:3]].apply(pd.to_numeric, errors="coerce")
    median = metres * sizes.median().to_numpy(np.float64)
    low, high = SIDES_M["Car"]
    possible = [bool(((low <= m) & (m <= high)).all()) for m in (median, 2 * median)]
    text = " x ".join(f"{side:.3g}" for side in median)
    return f"a Car is {text} m in the median" if possible == [False, True] else ""


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
