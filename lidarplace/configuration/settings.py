"""Base of all settings: kinds of numbers and of text with their ranges, and one error."""

import re
import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)

from lidarplace.base.class_names import CLASS_NAME, is_class_name
from lidarplace.base.errors import InputError
from lidarplace.base.ranges import ANGLE, LIDAR_HEIGHT, SEED, SHARE
from lidarplace.base.suggestions import did_you_mean

T = TypeVar("T")


class Settings(BaseModel):
    """Settings that do not change, and reject unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


# Strict, so that neither `true` nor "3" is a number. A field may add limits that its kind has not,
# such as `gt=0`; those that the kind has would win over the field's own (pydantic), so a narrower
# kind is `Annotated[Kind, Field(le=…)]`.

Count = Annotated[int, Strict(), Field(ge=0, le=10_000_000)]
CountFromOne = Annotated[int, Strict(), Field(ge=1, le=10_000_000)]
Seed = Annotated[int, Strict(), Field(ge=SEED.low, le=SEED.high)]
Length = Annotated[float, Strict(), Field(ge=-10_000, le=10_000, allow_inf_nan=False)]
"""Metres: a coordinate."""
Aside = Annotated[float, Strict(), Field(ge=-100, le=100, allow_inf_nan=False)]
"""Metres forward or to the left of the middle of a vehicle. Millimetres are mostly beyond."""
Height = Annotated[
    float, Strict(), Field(ge=LIDAR_HEIGHT.low, le=LIDAR_HEIGHT.high, allow_inf_nan=False)
]
"""Metres of a LiDAR above the ground."""
Distance = Annotated[float, Strict(), Field(ge=0, le=10_000, allow_inf_nan=False)]  # metres
Angle = Annotated[float, Strict(), Field(ge=ANGLE.low, le=ANGLE.high, allow_inf_nan=False)]
"""Radians, a turn to either side. Degrees that were taken for radians are mostly beyond."""
Degrees = Annotated[float, Strict(), Field(ge=-360, le=360, allow_inf_nan=False)]


def _up_to_a_turn(interval: tuple[float, float]) -> tuple[float, float]:
    if not 0 < interval[1] - interval[0] <= 360:
        raise InputError(expected="[min, max] with min < max and max - min <= 360")
    return interval


Turn = Annotated[tuple[Degrees, Degrees], AfterValidator(_up_to_a_turn)]
"""Azimuths from one to another, growing to the left; they may cross 180."""
Elevation = Annotated[float, Strict(), Field(ge=-90, le=90, allow_inf_nan=False)]
"""Degrees above the horizon."""
Probability = Annotated[float, Strict(), Field(ge=SHARE.low, le=SHARE.high, allow_inf_nan=False)]
Seconds = Annotated[float, Strict(), Field(ge=0, le=10_000_000, allow_inf_nan=False)]
"""Seconds of a wait, of work or of a simulation, up to 16 weeks."""
Factor = Annotated[float, Strict(), Field(ge=0, le=1_000_000, allow_inf_nan=False)]
"""A number without a unit that something is multiplied with."""
Amount = Annotated[float, Strict(), Field(ge=0, le=1e12, allow_inf_nan=False)]
"""Amount of money, or of gigabytes."""


def _without_currency(value: Any) -> Any:
    if isinstance(value, str):
        expected = "a number; all prices of a file are in the same currency"
        raise InputError(expected=expected, found=value, fix="convert it, and omit the currency")
    return value


Price = Annotated[Amount, BeforeValidator(_without_currency)]
"""Amount of money, in any currency."""
Number = Annotated[float, Strict(), Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
"""Number without a known range."""


def _class_name(name: str) -> str:
    if not is_class_name(name):
        raise InputError(expected=CLASS_NAME)
    return name


Name = Annotated[str, Field(min_length=1, max_length=100)]
"""Name of something: pages, tables and plots have room for it."""
ClassName = Annotated[str, AfterValidator(_class_name)]
Text = Annotated[str, Field(max_length=2000)]  # an address, or what another program has a name for


def _possible(path: Path) -> Path:
    if len(bytes(path)) > 4000 or any(len(part.encode()) > 255 for part in path.parts):
        raise InputError(expected="at most 4000 bytes, and 255 for the name of a file or a folder")
    return path


FilePath = Annotated[Path, AfterValidator(_possible)]
"""Path of a file or a folder, within the limits of file systems."""


def beside_the_file(path: Path, info: ValidationInfo) -> Path:
    """Resolve a path relative to the folder of the configuration where the context names that."""
    folder = (info.context or {}).get("folder")
    return path if folder is None else (folder / path).absolute()


FileBeside = Annotated[FilePath, AfterValidator(beside_the_file)]
"""Path of a file, relative to the folder of the configuration where the context names that."""


def short_for(key: str) -> BeforeValidator:
    """Let a string in place of a mapping be the value of `key`: `ray: debug`, `lidar: vlp16`."""
    return BeforeValidator(lambda value: {key: value} if isinstance(value, str) else value)


_short = reprlib.Repr()
_short.maxstring = _short.maxother = 100
_short.maxlist = 20
_LONGEST_KEY, _LONGEST_VALUE = 60, 300


_WORDS = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "tuple_type": "should be a list",
    "list_type": "should be a list",
    "dict_type": "should be a mapping",
    "model_type": "should be a mapping of keys",
    "path_type": "should be a path",
}
"""Messages in terms of YAML, by pydantic's type of error."""
_SHORT = {
    "should match pattern": "should be text of the pattern",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "more than",
    "a valid integer": "a whole number",
    "a valid number": "a number",
}
"""Other words of pydantic's."""


def fault(error: ValidationError, place: str = "") -> InputError:
    """Return the first mistake of an error with its parts; `place` is the file that has it."""
    first = error.errors(include_url=False)[0]
    return mistake(first, key_path(first["loc"]), place)


def mistake(first: Mapping[str, Any], key: str, place: str = "") -> InputError:
    """Convert one of pydantic's `errors()`, of that key of the file `place`."""
    inner = first.get("ctx", {}).get("error")
    if not isinstance(inner, InputError):
        text = _message(first)
        words = re.match(r"(should (be|have)|allowed (is|are)|expected) ", text)
        expected = text[words.end() :] if words else ""
        is_bool = first["type"] == "string_type" and isinstance(first["input"], bool)
        fix = "put text such as 'no' or 'on' into quotes, which YAML reads as a bool" * is_bool
        inner = InputError("" if words else text, expected=expected, fix=fix)
    if inner.place:
        return InputError(str(inner), place=place, key=key)
    key = ("." if first["loc"] else ": ").join(filter(None, (key, inner.key)))
    value = inner.found or _value(first)
    return InputError(**vars(inner) | {"place": place, "key": key, "found": value})


def _message(first: Mapping[str, Any]) -> str:
    kind, value, ctx = first["type"], first["input"], first.get("ctx", {})
    if kind in ("too_short", "too_long"):
        bound, end = ("at least", "min") if kind == "too_short" else ("at most", "max")
        number = ctx[f"{end}_length"]
        return f"should have {bound} {number} {'item' if number == 1 else 'items'}"
    if kind in ("tuple_type", "list_type") and isinstance(value, str):
        return f"should be a list, such as [{shortened(value)}]"
    text = str(first["msg"]).partition(", unable to parse")[0]
    for prefix in ("Value error, ", "Input ", "String "):
        text = text.removeprefix(prefix)
    for words, short in _SHORT.items():
        text = text.replace(words, short)
    angle = ctx.get("ge") == ANGLE.low or ctx.get("le") == ANGLE.high
    return _WORDS.get(kind, f"{text} radians" if angle else text)


def _value(first: Mapping[str, Any]) -> str:
    kind, value = first["type"], first["input"]
    if kind in ("missing", "json_invalid") or isinstance(value, (dict, BaseModel)):  # of all
        return ""
    names = kind == "literal_error" and re.findall("'([^']+)'", first["ctx"]["expected"])
    return excerpt(value) + (did_you_mean(value, names) if names and isinstance(value, str) else "")


def validated(kind: type[T], value: Any, place: str, folder: Path | None = None) -> T:
    """Validate a value as a model or another type; paths in it are relative to `folder`.

    Raises InputError: the first mistake, in the file `place`."""
    try:
        return TypeAdapter(kind).validate_python(value, context={"folder": folder})
    except ValidationError as error:
        raise fault(error, place) from None


def key_path(loc: Sequence[int | str]) -> str:
    """Write a place in nested settings as one would write it, `mounts[0].z`."""
    # Of a key that is wrong itself pydantic says "[key]" behind it.
    named = (part for part in loc if part != "[key]")
    parts = (f"[{part}]" if isinstance(part, int) else f".{shortened(part)}" for part in named)
    return "".join(parts).lstrip(".")


def excerpt(value: Any) -> str:
    """Write a value as Python does, cut where it is long."""
    text = _short.repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"


def shortened(key: str) -> str:
    """Cut a key of a file where it is long."""
    return key if len(key) <= _LONGEST_KEY else f"{key[:_LONGEST_KEY]}…"
