"""Paths of a configuration that hold in any folder."""

from pathlib import Path
from typing import Any

_BESIDE_THE_FILE = {"correction", "depends_on", "mesh", "pattern", "vehicle"}
"""Keys of paths that are relative to the folder of the configuration; `vehicle` may be short for
one. Other paths are relative to where a command is typed."""


def portable(value: Any, folder: Path, key: str = "") -> Any:
    """A checked configuration of which a copy elsewhere means the same files; or what is below
    `key` of it, or an axis that ends with it."""
    if isinstance(value, dict):
        if "command" in value:  # it runs next to the file
            value = value | {"folder": str((folder / value.get("folder", "")).absolute())}
        return {name: portable(own, folder, str(name)) for name, own in value.items()}
    if isinstance(value, list):
        return [portable(own, folder, key) for own in value]
    beside = isinstance(value, str) and key.rpartition(".")[2] in _BESIDE_THE_FILE
    # A name of one's own may be called like such a key.
    return str((folder / value).absolute()) if beside and (folder / value).exists() else value
