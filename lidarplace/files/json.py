"""JSON from files; what is wrong with a file is one line that names it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from lidarplace.configuration.settings import fault
from lidarplace.files.atomic import reading

T = TypeVar("T")


def read_record(path: Path, kind: type[T], what: str) -> T:
    """A JSON file as a dataclass or a pydantic model; `what` the file should be, for messages.

    Raises:
        ValueError: as `read_json`, or what the file holds is something else; names file and key.
    """
    try:
        return TypeAdapter(kind).validate_python(read_json(path))
    except ValidationError as error:
        raise ValueError(f"{path}: is no {what}: {fault(error)}") from None


def read_json(path: Path, object_hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """What a JSON file holds; `object_hook` is of `json.load`.

    Raises:
        ValueError: the file cannot be read, or is no JSON; names file and line.
    """
    with reading(path):
        try:
            with path.open(encoding="utf-8") as file:
                return json.load(file, object_hook=object_hook)
        except json.JSONDecodeError as error:
            raise ValueError(f"{path}: line {error.lineno}: no JSON: {error.msg}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: no JSON: byte {error.start} is not UTF-8") from None
        except RecursionError:
            raise ValueError(f"{path}: no JSON that can be read: it is nested too deep") from None
