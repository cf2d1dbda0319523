"""From a configuration file to the points of its grid, with errors a user can act on."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from lidarplace.yaml_loader import parse_yaml
from sweeps.config import METRICS, SCENES, Common, Point, SweepFile
from training.settings import TrainingSettings

Model = TypeVar("Model", bound=BaseModel)


class ConfigError(ValueError):
    """A mistake in the configuration: one line with file, key, value and what is allowed."""


@dataclass(frozen=True)
class GridPoint:
    """A point of the grid.

    Attributes:
        point: what is trained and evaluated.
        axes: its place on the axes, key path -> value.
        rung: which rung of `promote` it is trained for; their number for the full training.
        set_by_rungs: axes that rungs set, beside those of the grid.
    """

    point: Point
    axes: Mapping[str, Any]
    rung: int = 0
    set_by_rungs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sweep:
    """A configuration that has been read, checked and multiplied out.

    Attributes:
        common: what all points share.
        points: the product of the axes less what is excluded, last axis fastest; once for every
            rung of `promote` that trains, the full trainings last.
        axes: key paths of the grid, and those that rungs of `promote` set.
        source: the configuration after `--set`, as plain data.
    """

    common: Common
    points: tuple[GridPoint, ...]
    axes: tuple[str, ...]
    source: Mapping[str, Any]


def read_sweep(path: Path, overrides: Sequence[str] = ()) -> Sweep:
    """Read `path`, apply `KEY=VALUE` overrides (values are YAML), check all and build the grid.

    Raises:
        ConfigError: anything wrong with the file, a key or a value.
    """
    raw = _read_yaml(path)
    raw.setdefault("name", path.stem)
    for override in overrides:
        _override(raw, override, path)
    grid = _axes(raw, path)
    common = {key: value for key, value in raw.items() if key in Common.model_fields}
    base = {key: value for key, value in raw.items() if key not in (*common, "grid", "exclude")}
    for axis, values in grid.items():
        _put(base, axis, values[0], path)
    # Every value of every axis by itself first: the error can then name it.
    checked_common = _check(Common, common, path)
    _check(Point, base, path, {axis: f"grid.{axis}[0]" for axis in grid})
    for axis, values in grid.items():
        for i, value in enumerate(values[1:], start=1):
            varied = deepcopy(base)
            _put(varied, axis, value, path)
            _check(Point, varied, path, {axis: f"grid.{axis}[{i}]", "": f"grid.{axis}[{i}]"})
    exclude = _exclusions(raw.get("exclude", []), grid, path)

    rungs = _trained_rungs(checked_common, grid, path)
    points = []
    for rung, settings in rungs:
        for combination in itertools.product(*grid.values()):
            axes = dict(zip(grid, combination, strict=True))
            if any(all(axes[key] in values for key, values in rule.items()) for rule in exclude):
                continue
            data = deepcopy(base)
            for key, value in (axes | settings).items():
                _put(data, key, value, path)
            names = {key: f"promote[{rung}].set.{key}" for key in settings}
            point = _check(Point, data, path, names)
            if not settings:  # the full trainings
                _check_rungs(checked_common, point, path)
            try:
                checked_common.placement_named(point.placement, point.lidar.lidar())
            except ValueError as error:
                key = "grid.placement" if "placement" in grid else "placement"
                raise ConfigError(f"{path}: {key}: {error}") from None
            set_by_rungs = {key: _value_at(point, key) for _, own in rungs for key in own}
            points.append(GridPoint(point, axes | set_by_rungs, rung, tuple(set_by_rungs)))
    if not points:
        raise ConfigError(f"{path}: exclude: no point of the grid is left")
    return Sweep(checked_common, tuple(points), tuple(points[0].axes), raw)


def _trained_rungs(
    common: Common, grid: Mapping[str, Any], path: Path
) -> list[tuple[int, dict[str, Any]]]:
    """Rungs that train, by their number, and what they set; at last the full trainings."""
    rungs = []
    for number, rung in enumerate(common.promote):
        for key in rung.set:
            if key in grid:
                raise ConfigError(f"{path}: promote[{number}].set.{key}: is an axis of the grid")
            if not key.startswith("training."):
                raise ConfigError(
                    f"{path}: promote[{number}].set.{key}: allowed are keys of training, such as "
                    "training.epochs"
                )
        if rung.set:
            rungs.append((number, rung.set))
    return [*rungs, (len(common.promote), {})]


def _check_rungs(common: Common, point: Point, path: Path) -> None:
    """Refuse a rung that ranks by what the point has not."""
    for number, rung in enumerate(common.promote):
        key = f"{path}: promote[{number}]"
        if rung.by in METRICS and point.detector is None:
            raise ConfigError(f"{key}.by: {rung.by} needs a detector")
        if rung.by not in METRICS and rung.by not in point.surrogate.names:
            raise ConfigError(f"{key}.by: {rung.by} is not among surrogate.names")
        shorter = point.training.model_copy(
            update={key.removeprefix("training."): value for key, value in rung.set.items()}
        )
        if rung.set and _effort(shorter) >= _effort(point.training):
            raise ConfigError(
                f"{key}.set: these trainings see as many frames as the full ones; "
                "lower training.epochs or training.frame_share"
            )
        if rung.object_class and rung.object_class not in point.classes:
            raise ConfigError(f"{key}.class: {rung.object_class} is not among classes")


def _effort(training: TrainingSettings) -> float:
    """How often a training sees a frame of the data."""
    return training.epochs * training.frame_share


def _value_at(point: Point, key_path: str) -> Any:
    value: Any = point.model_dump(mode="json")
    for key in key_path.split("."):
        value = value[key]
    return value


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        raw = parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ConfigError(f"{path}: {where}{error.problem}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: found {type(raw).__name__}; a mapping of keys is expected")
    for key in raw:
        if key not in SweepFile.model_fields:
            raise ConfigError(f"{path}: {key}: {_unknown_key(str(key), SweepFile)}")
    return raw


def _override(raw: dict[str, Any], override: str, path: Path) -> None:
    key, equals, text = override.partition("=")
    key = key.strip()
    if not equals or not key:
        raise ConfigError(f"--set {override}: expected KEY=VALUE")
    try:
        value = parse_yaml(text)
    except yaml.YAMLError:
        raise ConfigError(f"--set {override}: the value is not YAML") from None
    if key.startswith("grid."):  # axes are key paths themselves: grid."training.lr"
        if not isinstance(raw.setdefault("grid", {}), dict):
            raise ConfigError(f"{path}: grid: found {raw['grid']!r}; allowed is a mapping")
        raw["grid"][key.removeprefix("grid.")] = value
        return
    if key in (raw.get("grid") or {}):
        raise ConfigError(f"--set {override}: {key} is an axis of the grid; use grid.{key}=[…]")
    if key.partition(".")[0] not in SweepFile.model_fields:
        raise ConfigError(f"--set {override}: {_unknown_key(key, SweepFile)}")
    _put(raw, key, value, path)


def _put(data: dict[str, Any], key_path: str, value: Any, path: Path) -> None:
    """Set the value at a dotted key path, making mappings on the way."""
    *parents, last = key_path.split(".")
    for key in parents:
        data = data.setdefault(key, {})
        if not isinstance(data, dict):
            raise ConfigError(f"{path}: {key_path}: {key} is {data!r}, not a mapping of keys")
    data[last] = value


def _axes(raw: Mapping[str, Any], path: Path) -> dict[str, list[Any]]:
    grid = raw.get("grid") or {}
    if not isinstance(grid, dict):
        raise ConfigError(f"{path}: grid: found {grid!r}; allowed is a mapping of key paths")
    for axis, values in grid.items():
        if str(axis).partition(".")[0] not in Point.model_fields:
            raise ConfigError(f"{path}: grid.{axis}: {_unknown_key(str(axis), Point)}")
        if not isinstance(values, list) or not values:
            raise ConfigError(
                f"{path}: grid.{axis}: found {values!r}; allowed is a list with a value or more"
            )
        repeated = [value for i, value in enumerate(values) if value in values[:i]]
        if repeated:
            raise ConfigError(f"{path}: grid.{axis}: {repeated[0]!r} is given twice")
    return grid


def _exclusions(
    rules: Any, grid: Mapping[str, list[Any]], path: Path
) -> list[dict[str, list[Any]]]:
    if not isinstance(rules, list):
        raise ConfigError(f"{path}: exclude: found {rules!r}; allowed is a list of mappings")
    checked = []
    for i, rule in enumerate(rules):
        if not isinstance(rule, dict) or not rule:
            raise ConfigError(
                f"{path}: exclude[{i}]: found {rule!r}; allowed is a mapping of axes to values"
            )
        lists = {key: v if isinstance(v, list) else [v] for key, v in rule.items()}
        for key, values in lists.items():
            if key not in grid:
                raise ConfigError(
                    f"{path}: exclude[{i}].{key}: no axis of the grid; "
                    f"allowed are {', '.join(grid) or 'none'}"
                )
            for value in values:
                if value not in grid[key]:
                    raise ConfigError(
                        f"{path}: exclude[{i}].{key}: found {value!r}; allowed are {grid[key]}"
                    )
        checked.append(lists)
    return checked


def _check(
    model: type[Model], data: Mapping[str, Any], path: Path, names: Mapping[str, str] | None = None
) -> Model:
    """Validate, and turn the first error into one line.

    `names` maps a key path to what the user wrote it as; the empty path is the model as a whole.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        loc = _without_tags(first["loc"])
        key_path = ".".join(str(part) for part in loc if isinstance(part, str))
        written = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in loc).lstrip(".")
        index = "".join(f"[{part}]" for part in loc if isinstance(part, int))
        key = names[key_path] + index if names and key_path in names else written
        if first["type"] == "extra_forbidden":
            parent = _model_at(model, first["loc"][:-1])
            message = _unknown_key(str(loc[-1]), parent)
        elif first["type"] == "missing":
            message = "is missing"
        else:
            text = first["msg"].removeprefix("Value error, ").removeprefix("Input ")
            found = first["input"]
            message = text if isinstance(found, (dict, BaseModel)) else f"found {found!r}; {text}"
        raise ConfigError(f"{path}: {key}: {message}" if key else f"{path}: {message}") from None


def _without_tags(loc: Sequence[int | str]) -> list[int | str]:
    """A place as the user wrote it: pydantic adds which kind of scene it is."""
    return [p for i, p in enumerate(loc) if not (loc[i - 1 : i] == ("scene",) and p in SCENES)]


def _model_at(model: type[BaseModel], loc: Sequence[int | str]) -> type[BaseModel]:
    """The model that a key path of `model` leads to."""
    for part in loc:
        if isinstance(part, str) and part in model.model_fields:
            found = _model_in(model.model_fields[part].annotation)
            model = found or model
        elif part in SCENES:
            model = SCENES[part]
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model in an annotation such as `dict[str, Model]` or `tuple[Model, ...]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_in(argument) for argument in getattr(annotation, "__args__", ()))
    return next((model for model in inner if model), None)


def _unknown_key(key: str, model: type[BaseModel]) -> str:
    allowed = [field.alias or name for name, field in model.model_fields.items()]
    close = difflib.get_close_matches(key.partition(".")[0], allowed, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    return f"unknown key{hint}; allowed are {', '.join(allowed)}"
