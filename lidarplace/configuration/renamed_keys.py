"""Keys of configurations and columns of tables that were renamed; old names work until 2.0."""

from collections.abc import Mapping
from typing import Any

from lidarplace.base.errors import InputError

RENAMED_KEYS = {"judge": "evaluator"}
"""Current name by old name."""


def current_key(key_path: str) -> str:
    """Replace a renamed first key of a dotted path, such as "judge.cpus" by "evaluator.cpus"."""
    first, dot, rest = key_path.partition(".")
    return RENAMED_KEYS.get(first, first) + dot + rest


def with_current_keys(settings: Mapping[Any, Any], place: str = "") -> dict[Any, Any]:
    """Return settings under the current names of their keys, in their order.

    `place` is the key path of the settings, for the error. Raises InputError if a key is set under
    both names."""
    for key in settings:
        name = current_key(str(key))
        if name != str(key) and name in settings:
            problem = f"set twice, as {name} is its new name"
            raise InputError(problem, key=f"{place}.{key}".lstrip("."), fix=f"remove {key}")
    return {current_key(k) if isinstance(k, str) else k: v for k, v in settings.items()}
