"""JSON from files; what is wrong with a file is one line that names it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError, at
from lidarplace.files.atomic import first_line, reading
from lidarplace.files.regular import regular


def read_json(path: Path, object_hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """Read a JSON file, see `json.load`. Raises ValueError that names file and line."""
    with reading(path), at(path):
        try:
            with regular(path).open(encoding="utf-8-sig") as file:
                return json.load(file, object_hook=object_hook)
        except json.JSONDecodeError as error:
            raise InputError(f"not JSON: {error.msg}", place=f"line {error.lineno}") from None
        except UnicodeDecodeError as error:
            raise InputError(f"not JSON: {first_line(error)}") from None
        except RecursionError:
            raise InputError("not JSON: nested too deep") from None
        except ValueError:  # of Python's integers
            raise InputError("not JSON: a number of more than 4,300 digits") from None
