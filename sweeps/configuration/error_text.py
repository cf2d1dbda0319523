"""What pydantic says of a value in terms of Python, in those of YAML."""

from collections.abc import Mapping
from typing import Any

_WORDS = {
    "tuple_type": "should be a list",
    "list_type": "should be a list",
    "dict_type": "should be a mapping",
    "model_type": "should be a mapping of keys",
    "path_type": "should be a path",
}
"""By pydantic's type of mistake."""


def plainly(mistake: Mapping[str, Any]) -> dict[str, Any]:
    """One of pydantic's `errors()` with a message in terms of YAML."""
    said = str(mistake["msg"]).removeprefix("String ")
    if mistake["type"] in ("too_short", "too_long"):
        bound, end = ("at least", "min") if mistake["type"] == "too_short" else ("at most", "max")
        number = mistake["ctx"][f"{end}_length"]
        said = f"needs {bound} {number} {'item' if number == 1 else 'items'}"
    return {**mistake, "msg": _WORDS.get(mistake["type"], said)}
