"""Folders that plug-ins are imported from: a configuration's, then the current one."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import Distribution
from pathlib import Path
from types import ModuleType

Folders = tuple[Path, ...]

PLUGINS: dict[str, Distribution | None] = {}
"""Top-level packages of plug-ins that were looked up, and what installed them; None: a folder."""

_CURRENT = ""
"""Entry of `sys.path` for the current folder."""

_blocks: list[Path] = []
_active: Folders = ()
_set_aside: dict[Path, tuple[dict[str, ModuleType], dict[str, Distribution | None]]] = {}
"""Modules, and their part of PLUGINS, of folders that are not active."""


def active_folders() -> Folders:
    """Return the folders of the innermost `plugin_folder` block, or else of the last one."""
    return _active


@contextmanager
def plugin_folder(folder: Path) -> Iterator[None]:
    """Import plug-ins from the folder of a configuration, then from the current one, in a block.

    In nested blocks the inner folder comes first. Modules from the folders of other configurations
    are set aside until these are active again: each configuration has its own modules of the same
    name. After the block `sys.path` is as before; the modules stay imported, as they are in use."""
    _blocks.append(folder.resolve())
    try:
        _activate(tuple(reversed(_blocks)))
        with _importable(str(_blocks[-1]), _CURRENT):
            yield
    finally:
        _blocks.pop()
        if _blocks:
            _activate(tuple(reversed(_blocks)))


@contextmanager
def current_folder() -> Iterator[None]:
    """Import from the current folder, too, in a block."""
    with _importable(_CURRENT):
        yield


@contextmanager
def _importable(*entries: str) -> Iterator[None]:
    missing = [entry for entry in entries if entry not in sys.path]
    sys.path += missing
    try:
        yield
    finally:
        for entry in set(missing).intersection(sys.path):
            sys.path.remove(entry)


def _activate(folders: Folders) -> None:
    global _active
    for folder in set(_active).difference(folders):
        if str(folder) not in sys.path:
            packages = {name for name in sys.modules if _folder_of(name) == folder}
            modules = {
                name: module
                for name, module in sys.modules.items()
                if name.partition(".")[0] in packages
            }
            plugins = {name: PLUGINS.pop(name) for name in packages & PLUGINS.keys()}
            _set_aside[folder] = modules, plugins
            for name in modules:
                del sys.modules[name]
    for folder in reversed(folders):
        modules, plugins = _set_aside.pop(folder, ({}, {}))
        sys.modules.update(modules)
        PLUGINS.update(plugins)
    _active = folders


def _folder_of(name: str) -> Path | None:
    """Return the folder that a top-level module was imported from; None for other modules."""
    spec = None if "." in name else getattr(sys.modules[name], "__spec__", None)
    places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin]
    return Path(places[0]).parent if places and places[0] else None
