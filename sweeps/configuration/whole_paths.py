"""Paths of a configuration that hold in any folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

BESIDE_THE_FILE = {"correction", "depends_on", "mesh", "pattern", "vehicle"}
"""Keys of paths that are relative to the folder of the configuration; `vehicle` may be short for
one."""


def with_whole_paths(config: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A checked configuration with paths that hold in any folder, so that a copy can be read.

    Files of a mesh, a pattern and a correction are next to the file, in `folder`; other paths are
    relative to where a command is typed.
    """
    return {key: _with_whole_paths(value, key, folder) for key, value in config.items()}


def _with_whole_paths(value: Any, key: str, folder: Path) -> Any:
    """What is below `key`, or an axis that ends with it."""
    if isinstance(value, dict):
        if "command" in value:  # it runs next to the file
            value = value | {"folder": str((folder / value.get("folder", "")).absolute())}
        return {name: _with_whole_paths(own, str(name), folder) for name, own in value.items()}
    if isinstance(value, list):
        return [_with_whole_paths(own, key, folder) for own in value]
    beside = isinstance(value, str) and key.rpartition(".")[2] in BESIDE_THE_FILE
    # A name of one's own may be called like such a key.
    return str((folder / value).absolute()) if beside and (folder / value).exists() else value
