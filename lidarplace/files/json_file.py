"""JSON from files; what is wrong with a file is one line that names it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import reading
from lidarplace.files.regular import regular


def read_json(path: Path, object_hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """The content of a JSON file, see `json.load`. Raises ValueError that names file and line."""
    with reading(path):
        try:
            with regular(path).open(encoding="utf-8") as file:
                return json.load(file, object_hook=object_hook)
        except json.JSONDecodeError as error:
            raise InputError(
                f"no JSON: {error.msg}", place=f"{path}: line {error.lineno}"
            ) from None
        except UnicodeDecodeError as error:
            raise InputError(f"no JSON: byte {error.start} is not UTF-8", place=path) from None
        except RecursionError:
            raise InputError(
                "no JSON that can be read: it is nested too deep", place=path
            ) from None
        except ValueError:  # of Python's integers
            raise InputError("no JSON: a number of more than 4,300 digits", place=path) from None
