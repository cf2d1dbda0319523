"""A configuration file as plain data, validated against its model: one line for a mistake."""

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from lidarplace.base.errors import InputError, at
from lidarplace.base.suggestions import did_you_mean
from lidarplace.command_line.invocation import command
from lidarplace.configuration.answer import (
    ALLOWANCES,
    as_requirements,
    as_search,
    as_sweep,
    is_answer,
)
from lidarplace.configuration.renamed_keys import current_key, with_current_keys
from lidarplace.configuration.settings import key_path, mistake, shortened
from lidarplace.configuration.yaml import YamlError, parse_yaml, read_yaml_file
from lidarplace.files.secret_urls import hide_secrets_in
from lidarplace.scenes.kinds import KINDS, source_of
from sweeps.configuration.sweep import NAME

Model = TypeVar("Model", bound=BaseModel)


_SWEEP = ("a sweep", "run")
_VERBS = {"search": ("a search", "search"), "grid": _SWEEP, "exclude": _SWEEP}
_VERBS["prices"] = ("a file of the studio", "studio")
"""Keys that only one kind of file has, and the verb that takes it."""
_AS = {"search": as_search, "grid": as_sweep, "rigs": as_requirements}
"""A key that a kind of file alone has, and the answer of a search as such a file."""
_OF_KEY_PATHS = {"grid", "exclude", "promote", "set", "verify", "search", "objective"}
"""Keys of sweeps and searches whose value has, at some depth, keys of a point."""

_log = logging.getLogger(__name__)


class ConfigError(InputError):
    """A mistake in the configuration: one line with file, key, value and what is allowed."""


@contextmanager
def reading(key: str) -> Iterator[None]:
    """Put a key of files in front of errors of the block; an OSError becomes ConfigError, too."""
    with at(key=key, error=ConfigError):
        try:
            yield
        except OSError as error:
            raise InputError(str(error.strerror or error), place=error.filename or "") from None


def read_yaml(path: Path, overrides: Sequence[str], model: type[BaseModel]) -> dict[str, Any]:
    """Read the mapping in `path`, whose keys are fields of `model`, with `--set KEY=VALUE`.

    Values are not validated. Raises ConfigError: unreadable, or overrides do not fit."""
    try:
        raw = read_yaml_file(path)
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror}", place=path) from None
    except YamlError as error:
        raise ConfigError(**vars(error)) from None
    with at(path, ConfigError):
        if not isinstance(raw, dict):
            kind_of_content = "nothing" if raw is None else type(raw).__name__
            raise InputError(expected="a mapping of keys", found=kind_of_content)
        if is_answer(raw):
            raw = _AS[next(key for key in _AS if key in model.model_fields)](raw, path)
        elif "prices" in raw and "rigs" in model.model_fields:
            raw = {key: value for key, value in raw.items() if key not in ALLOWANCES}
        written, raw = raw, _with_current_keys(raw)
        is_outdated = raw != written
        unknown = [key for key in raw if key not in model.model_fields]
        for key, (kind, verb) in _VERBS.items():
            if key in unknown:
                fix = f"run: {command(verb, str(path))}"
                raise InputError(f"key of {kind}", key=key, fix=fix)
        for key in map(str, unknown):
            raise unknown_key(key, model, key=shortened(key))
    for pair in overrides:
        key = split_override(pair)[0].removeprefix("grid.")
        is_outdated |= key != current_key(key)
        _override(raw, pair, path, model)
    with at("--set", ConfigError):
        current: dict[str, Any] = _with_current_keys(raw)
    if is_outdated or current != raw:
        _log.warning("warning: %s: judge: renamed to evaluator; judge works until 2.0", path)
    return current


def _with_current_keys(value: Any, place: str = "") -> Any:
    """Return what a configuration has at the key path `place` without old names of keys."""
    if isinstance(value, list):
        return [_with_current_keys(item, f"{place}[{i}]") for i, item in enumerate(value)]
    if not isinstance(value, dict):
        return value
    current = with_current_keys(value, place)
    for key in _OF_KEY_PATHS & current.keys():
        current[key] = _with_current_keys(current[key], f"{place}.{key}".lstrip("."))
    return current


def public_yaml(config: Mapping[str, Any]) -> str:
    """Return a configuration as written into a file or a page: without secrets."""
    return yaml.safe_dump(hide_secrets_in(dict(config)), sort_keys=False)


def read_named(
    path: Path,
    overrides: Sequence[str],
    model: type[BaseModel],
    changes: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Read a configuration as `read_yaml`, whose name is that of the file where it has none.

    `changes`: key path -> plain data, set after `overrides`. Raises ConfigError."""
    raw = read_yaml(path, overrides, model)
    with at(path, ConfigError):
        for key, value in (changes or {}).items():
            put(raw, key, value)
    if "name" not in raw and not re.fullmatch(NAME, path.stem):
        other = re.sub(r"[^\w.-]+", "_", path.stem).lstrip(".-") or "mine"
        problem, expected = "the default is that of the file", "letters, digits and _.- alone"
        fix = f"set another, such as --set name={other}"
        stem = repr(path.stem)
        raise ConfigError(problem, place=path, key="name", expected=expected, found=stem, fix=fix)
    return {**raw, "name": raw.get("name", path.stem)}


def split_override(pair: str) -> tuple[str, str]:
    """Return key path and value of a `--set`. Raises ConfigError."""
    key, equals, text = pair.partition("=")
    if not equals or not key.strip():
        such = f", such as --set {key.strip()}=3" if key.strip() else ""
        raise ConfigError(place=f"--set {pair}", expected=f"KEY=VALUE, with = between them{such}")
    return key.strip(), text


def _override(raw: dict[str, Any], pair: str, path: Path, model: type[BaseModel]) -> None:
    key, text = split_override(pair)
    try:
        value = parse_yaml(text)
    except YamlError as error:
        raise ConfigError(f"the value: {error}", place=f"--set {pair}") from None
    key = current_key(key)
    if key.partition(".")[0] not in model.model_fields:
        raise unknown_key(key, model, place=f"--set {pair}")
    if key.startswith("grid."):  # its keys are key paths: grid."training.lr"
        grid = raw.setdefault("grid", {})
        if not isinstance(grid, dict):
            raise ConfigError(place=path, key="grid", expected="a mapping", found=repr(grid))
        grid[current_key(key.removeprefix("grid."))] = value
        return
    axes = raw["grid"] if isinstance(raw.get("grid"), dict) else {}
    for axis in axes:
        if f"{key}.".startswith(f"{axis}."):
            fix = f"use grid.{axis}=[…]"
            raise ConfigError(f"{axis} is an axis of the grid", place=f"--set {pair}", fix=fix)
    with at(path, ConfigError):
        put(raw, key, value)


def put(data: dict[str, Any], key_path: str, value: Any) -> None:
    """Set the value at a dotted key path, in copies of the mappings or settings on the way."""
    *parents, last = key_path.split(".")
    for key in parents:
        inner = data.get(key, {})
        if isinstance(inner, BaseModel):
            fields = type(inner).model_fields
            inner = {fields[k].alias or k: getattr(inner, k) for k in inner.model_fields_set}
        if not isinstance(inner, dict):
            raise InputError(f"{key} is {inner!r}, not a mapping of keys", key=key_path)
        data[key] = data = dict(inner)
    data[last] = deepcopy(value)


def check(
    model: type[Model],
    data: Mapping[str, Any],
    path: Path,
    names: Mapping[str, str] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Model:
    """Validate data with `changes` by key path; raise the first mistake as InputError.

    `path` is the file of the data. `names` maps a key path to what the user wrote it as; the empty
    path is the model as a whole."""
    data = dict(data)
    for changed, value in (changes or {}).items():
        put(data, changed, value)
    try:
        return model.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        first = error.errors()[0]
        loc = first["loc"]
        keys = ".".join(part for part in loc if isinstance(part, str))
        index = "".join(f"[{part}]" for part in loc if isinstance(part, int))
        key = names[keys] + index if names and keys in names else key_path(loc)
        if first["type"] == "extra_forbidden":
            raise unknown_key(str(loc[-1]), _model_at(model, loc[:-1], data), key) from None
        raise mistake(first, key) from None


def _model_at(
    model: type[BaseModel], loc: Sequence[int | str], data: Mapping[str, Any]
) -> type[BaseModel]:
    for part in loc:
        if part == "scene":
            model = KINDS[source_of(data[part])].settings
        elif isinstance(part, str) and part in model.model_fields:
            model = _model_in(model.model_fields[part].annotation) or model
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the model in an annotation such as `dict[str, Model]` or `tuple[Model, ...]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_in(argument) for argument in getattr(annotation, "__args__", ()))
    return next((model for model in inner if model), None)


def unknown_key(name: str, model: type[BaseModel], key: str = "", place: str = "") -> ConfigError:
    """Return the error of an unknown key, with a suggestion."""
    allowed = [field.alias or name for name, field in model.model_fields.items()]
    problem = f"unknown key{did_you_mean(name.partition('.')[0], allowed)}"
    return ConfigError(problem, place=place, key=key, expected=f"one of {', '.join(allowed)}")
