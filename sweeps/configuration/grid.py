"""Points of the grid of a configuration file, with errors a user can act on."""

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from lidarplace.base.class_names import check_among
from lidarplace.base.errors import InputError, at
from lidarplace.base.metrics import METRICS, RANKING
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.base.roi import Roi
from lidarplace.clouds.blind_lidars import check_not_blind
from lidarplace.clouds.own_body import check_mounts
from lidarplace.configuration.settings import excerpt, shortened
from lidarplace.configuration.vehicle import vehicle_of
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.scenes.kinds import obstacles_around, poles_at
from lidarplace.scenes.recorded import LogScene
from lidarplace.scenes.site import Poles
from sweeps.configuration.file import ConfigError, check, read_named, unknown_key
from sweeps.configuration.point import Point
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.sweep import Common, SweepFile
from sweeps.configuration.whole_paths import portable
from tracking.findings.groups import ONE_FOR_ALL
from training.settings import TrainingSettings

MOST_POINTS = 20_000
"""Most points of a grid; each takes milliseconds: beyond, axes were likelier confused."""


@dataclass(frozen=True)
class GridPoint:
    """A point of the grid.

    Attributes:
        rig: its placement, with its LiDARs and in its weather.
        axes: its place on the axes, key path -> value.
        rung: index of the rung of `promote` that trains it; their number for the full training.
        set_by_rungs: axes that rungs set, in addition to those of the grid."""

    point: Point
    rig: Placement
    axes: Mapping[str, Any]
    rung: int = 0
    set_by_rungs: tuple[str, ...] = ()

    @cached_property
    def roi(self) -> Roi:
        """The region of interest."""
        return self.point.voxel_roi()

    @cached_property
    def vehicle(self) -> Vehicle | None:
        """The vehicle that carries the LiDARs; None: a sedan."""
        settings = self.point.vehicle
        return None if settings is None else settings.vehicle()

    @cached_property
    def poles(self) -> Poles | None:
        """Carrier of the LiDARs at a site, with its surroundings; None: a vehicle carries them."""
        if self.point.site is None:
            return None
        return poles_at(self.point.scene, self.point.site, vehicle_of(self.point.vehicle))


@dataclass(frozen=True)
class Sweep:
    """A configuration that has been read, validated and multiplied out.

    Attributes:
        points: the product of the axes less what is excluded, last axis fastest; once for every
            rung of `promote` that trains, the full trainings last.
        axes: key paths of the grid, and those that rungs of `promote` set.
        source: the configuration after `--set`, as plain data.
        rigs: of the points, and all others that the configuration names.
        path: its file."""

    common: Common
    points: tuple[GridPoint, ...]
    axes: tuple[str, ...]
    source: Mapping[str, Any]
    rigs: Rigs
    path: Path


def read_sweep(
    path: Path, overrides: Sequence[str] = (), changes: Mapping[str, Any] | None = None
) -> Sweep:
    """Read `path`, apply `KEY=VALUE` overrides (values are YAML), check all and build the grid.

    `changes`: key path -> plain data, set after `overrides`. Raises ConfigError."""
    raw = read_named(path, overrides, SweepFile, changes)
    with at(path, ConfigError), plugin_folder(path.parent):
        sweep = build_sweep(raw, path)
        _check_mounts(sweep)
        return sweep


def build_sweep(raw: dict[str, Any], path: Path) -> Sweep:
    """Build the sweep of the configuration `path`, given as plain data. Raises InputError."""
    grid = _axes(raw)
    common = {key: value for key, value in raw.items() if key in Common.model_fields}
    of_point = {key: value for key, value in raw.items() if key not in (*common, "grid", "exclude")}
    # Every value of every axis by itself first: the error can then name it.
    checked_common = check(Common, common, path)
    at_first = {axis: values[0] for axis, values in grid.items()}
    first = check(Point, of_point, path, {axis: f"grid.{axis}[0]" for axis in grid}, at_first)
    rigs = Rigs(checked_common.placements, first)
    _check_own_values(of_point, at_first, rigs, first, path)
    rungs = _trained_rungs(checked_common, grid)
    # A section in which nothing varies is one object for all points: one log is read once.
    varied = {k.partition(".")[0] for k in (*grid, *(k for _, settings in rungs for k in settings))}
    sections = {key: getattr(first, key) for key in of_point.keys() - varied}
    base = of_point | {
        key: value for key, value in sections.items() if isinstance(value, BaseModel)
    }
    for axis, values in grid.items():
        for i, value in enumerate(values[1:], start=1):
            names = {axis: f"grid.{axis}[{i}]", "": f"grid.{axis}[{i}]"}
            check(Point, base, path, names, at_first | {axis: value})
    exclude = _exclusions(raw.get("exclude", []), grid)
    points = []
    for rung, settings in rungs:
        for combination in itertools.product(*grid.values()):
            axes = dict(zip(grid, combination, strict=True))
            if any(all(_key(axes[k]) in v for k, v in rule.items()) for rule in exclude):
                continue
            names = {key: f"promote[{rung}].set.{key}" for key in settings}
            point = check(Point, base, path, names, axes | settings)
            if not settings:  # the full trainings
                _check_rungs(checked_common, point)
            with at(key="grid.placement" if "placement" in grid else "placement"):
                rig = rigs.of(point)
            plain: Any = point.model_dump(mode="json")
            set_by_rungs = {
                key: reduce(getitem, key.split("."), plain)
                for _, of_point in rungs
                for key in of_point
            }
            axes |= set_by_rungs
            if "evaluator" in axes:
                axes["evaluator"] = point.evaluator_name
            points.append(GridPoint(point, rig, axes, rung, tuple(set_by_rungs)))
    if not points:
        raise InputError("no point of the grid is left", key="exclude")
    source = portable(raw, path.parent)
    return Sweep(checked_common, tuple(points), tuple(points[0].axes), source, rigs, path)


def _check_mounts(sweep: Sweep) -> None:
    """Reject rigs with a LiDAR inside of the vehicle or a wall, or that sees nothing of the ROI.

    Only where clouds are simulated. A sweep that a search makes is not checked: in addition to its
    own rigs, which keep out of the body, it has the paper's for comparison, whatever vehicle they
    are on."""
    checked = set()
    for grid_point in sweep.points:
        point = grid_point.point
        if isinstance(point.scene, LogScene) and point.scene.clouds == "recorded":
            continue
        where = (point.vehicle, point.site, point.site and point.scene)
        conditions = (point.placement, point.lidar, *where, point.roi, point.weather)
        if conditions in checked:
            continue
        checked.add(conditions)
        obstacles = None if point.site is None else obstacles_around(point.scene, point.site)
        with at(key="placement"):
            check_mounts(grid_point.rig, grid_point.vehicle)
            if obstacles is not None:
                obstacles.check(grid_point.rig)
            if not sweep.common.allow_blind_lidars:
                check_not_blind(grid_point.rig, grid_point.roi, grid_point.vehicle)


def _check_own_values(
    of_point: Mapping[str, Any], at_first: Mapping[str, Any], rigs: Rigs, first: Point, path: Path
) -> None:
    """Reject wrong values outside of the grid, though an axis replaces them."""
    for key in dict.fromkeys(axis.partition(".")[0] for axis in at_first):
        if key in of_point:
            own_axes = [a for a in at_first if a.partition(".")[0] == key and _has(of_point, a)]
            changes = {axis: value for axis, value in at_first.items() if axis not in own_axes}
            check(Point, of_point, path, changes=changes)
    if "placement" in of_point and "placement" in at_first:
        with at(key="placement"):
            rigs.of(first, str(of_point["placement"]))


def _has(data: Any, key_path: str) -> bool:
    for key in key_path.split("."):
        if not isinstance(data, dict) or key not in data:
            return False
        data = data[key]
    return True


def _trained_rungs(common: Common, grid: Mapping[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    """Return rungs that train, by their number, and what they set; at last the full trainings."""
    rungs = []
    for number, rung in enumerate(common.promote):
        where = f"promote[{number}].set"
        for key in rung.set:
            if key in grid:
                raise InputError("is an axis of the grid", key=f"{where}.{key}")
            if key != "evaluator" and not key.startswith("training."):
                expected = "evaluator or a key of training, such as training.epochs"
                raise InputError(key=f"{where}.{key}", expected=expected)
        refuse_overlaps(rung.set, where, grid, "an axis of the grid")
        if rung.set:
            rungs.append((number, rung.set))
    return [*rungs, (len(common.promote), {})]


def _check_rungs(common: Common, point: Point) -> None:
    for number, rung in enumerate(common.promote):
        key = f"promote[{number}]"
        if rung.by in RANKING and point.detector is None:
            raise InputError(f"{rung.by} needs a detector", key=f"{key}.by")
        if rung.by not in RANKING and rung.by not in point.surrogate.names:
            raise InputError(f"{rung.by} is not among surrogate.names", key=f"{key}.by")
        if rung.by in RANKING and rung.by not in (*METRICS.own, *point.metrics):
            raise InputError(f"{rung.by} is not among metrics", key=f"{key}.by")
        training = {
            key.removeprefix("training."): v for key, v in rung.set.items() if key != "evaluator"
        }
        shorter = point.training.model_copy(update=training)
        cheaper = rung.set.get("evaluator") in ONE_FOR_ALL and point.evaluator not in ONE_FOR_ALL
        if rung.set and not cheaper and _effort(shorter) >= _effort(point.training):
            problem = "these trainings see as many frames as the full ones"
            fix = "lower training.epochs or training.frame_share"
            raise InputError(problem, key=f"{key}.set", fix=fix)
        if rung.object_class:
            check_among([rung.object_class], point.classes, key=f"{key}.class")


def refuse_overlaps(
    key_paths: Collection[str],
    where: str,
    others: Collection[str] = (),
    whose: str = "which is also set",
) -> None:
    """Reject a key path of the mapping `where` inside of another, or of one set in `others`.

    `whose` describes the others: which of the two counts would depend on their order. Raises
    InputError."""
    for outer, inner in (*_nested(key_paths, key_paths), *_nested(others, key_paths)):
        relation = "which is also set" if outer in key_paths else whose
        raise InputError(f"is inside {outer}, {relation}", key=f"{where}.{inner}")
    for outer, inner in _nested(key_paths, others):
        raise InputError(f"has {inner} inside, {whose}", key=f"{where}.{outer}")


def _nested(outer: Iterable[str], inner: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield pairs of which the second is a key path inside of the first."""
    outer_paths = set(outer)
    for path in inner:
        for i, letter in enumerate(path):
            if letter == "." and path[:i] in outer_paths:
                yield path[:i], path


def _effort(training: TrainingSettings) -> float:
    return training.epochs * training.frame_share


def _axes(raw: Mapping[str, Any]) -> dict[str, list[Any]]:
    grid = raw.get("grid") or {}
    if not isinstance(grid, dict):
        raise InputError(key="grid", expected="a mapping of key paths", found=excerpt(grid))
    for axis, values in grid.items():
        key = f"grid.{shortened(str(axis))}"
        if str(axis).partition(".")[0] not in Point.model_fields:
            raise unknown_key(str(axis), Point, key)
        if not isinstance(values, list) or not values:
            raise InputError(key=key, expected="a list of at least 1 value", found=excerpt(values))
        seen = set()
        for value in values:
            if _key(value) in seen:
                raise InputError(f"duplicate value {excerpt(value)}", key=key)
            seen.add(_key(value))
    refuse_overlaps(grid, "grid")
    commands = [value for value in grid.get("evaluator", ()) if isinstance(value, dict)]
    names = [command.get("name", "command") for command in commands]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"duplicate name {excerpt(name)} of commands", key="grid.evaluator")
    points = math.prod(len(values) for values in grid.values())
    if points > MOST_POINTS:
        expected = f"at most {MOST_POINTS:,} points"
        raise InputError(key="grid", expected=expected, found=f"{points:,}")
    return grid


def _key(value: Any) -> Any:
    """Return something hashable that is equal for equal values."""
    if isinstance(value, dict):
        return "mapping", frozenset((key, _key(inner)) for key, inner in value.items())
    return ("list", *map(_key, value)) if isinstance(value, list) else value


def _exclusions(rules: Any, grid: Mapping[str, list[Any]]) -> list[dict[str, set[Any]]]:
    """Return the excluded values of the axes of every rule, as `_key` has them."""
    if not isinstance(rules, list):
        raise InputError(key="exclude", expected="a list of mappings", found=excerpt(rules))
    keys_by_axis = {axis: {_key(value) for value in values} for axis, values in grid.items()}
    checked = []
    for i, rule in enumerate(rules):
        if not isinstance(rule, dict) or not rule:
            expected = "a mapping of axes to values"
            raise InputError(key=f"exclude[{i}]", expected=expected, found=excerpt(rule))
        lists = {key: v if isinstance(v, list) else [v] for key, v in rule.items()}
        for key, values in lists.items():
            where = f"exclude[{i}].{shortened(str(key))}"
            if key not in grid:
                expected = ", ".join(grid) or "none"
                raise InputError("no axis of the grid", key=where, expected=expected)
            for value in values:
                if _key(value) not in keys_by_axis[key]:
                    expected = f"one of {excerpt(grid[key])}"
                    raise InputError(key=where, expected=expected, found=excerpt(value))
        checked.append({key: set(map(_key, values)) for key, values in lists.items()})
    return checked
