"""JSON from files; what is wrong with a file is one line that names it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lidarplace.files.atomic import reading
from lidarplace.files.regular import regular


def read_json(path: Path, object_hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """The content of a JSON file, see `json.load`. Raises ValueError that names file and line."""
    with reading(path):
        try:
            with regular(path).open(encoding="utf-8") as file:
                return json.load(file, object_hook=object_hook)
        except json.JSONDecodeError as error:
            raise ValueError(f"{path}: line {error.lineno}: no JSON: {error.msg}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: no JSON: byte {error.start} is not UTF-8") from None
        except RecursionError:
            raise ValueError(f"{path}: no JSON that can be read: it is nested too deep") from None
        except ValueError:  # of Python's integers
            raise ValueError(f"{path}: no JSON: a number of more than 4,300 digits") from None
