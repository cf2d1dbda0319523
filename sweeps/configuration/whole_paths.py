"""Paths of a configuration that are valid in any folder."""

from pathlib import Path
from typing import Any

_BESIDE_THE_FILE = {"correction", "depends_on", "mesh", "pattern", "vehicle"}
"""Keys of paths that are relative to the folder of the configuration; `vehicle` may be one.

Other paths are relative to the folder of the command."""


def portable(value: Any, folder: Path, key: str = "") -> Any:
    """Return a validated configuration of which a copy elsewhere names the same files.

    `key`: where in the configuration the value is."""
    if isinstance(value, dict):
        if "command" in value:  # it runs next to the file
            value = value | {"folder": str((folder / value.get("folder", "")).absolute())}
        return {name: portable(inner, folder, str(name)) for name, inner in value.items()}
    if isinstance(value, list):
        return [portable(inner, folder, key) for inner in value]
    is_relative = isinstance(value, str) and key.rpartition(".")[2] in _BESIDE_THE_FILE
    # A name of one's own may be called like such a key.
    return str((folder / value).absolute()) if is_relative and (folder / value).exists() else value
