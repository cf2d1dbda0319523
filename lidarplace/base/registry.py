"""Registries of what can be added from outside: names of ours and of plug-ins.

Plug-ins are installed packages, whose names are entry points, and `package.module:name`. They are
imported when one of their names is looked up, or when all that is installed is listed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from itertools import product
from typing import Any, TypeVar, cast

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from lidarplace.base.errors import InputError
from lidarplace.base.foreign_code import finite_number, foreign_code, import_plugin
from lidarplace.base.plugin_folders import PLUGINS, Folders, active_folders

T = TypeVar("T")

_log = logging.getLogger(__name__)


class PluginError(InputError, KeyError):
    """A name that cannot be resolved."""

    def __str__(self) -> str:
        return str(self.args[0])


class Registry(Mapping[str, T]):
    """Things of one kind by name: `own`, and those of a group of entry points that `fits` accepts.

    It iterates over ours and over what was looked up by name; `installed` has all. Indexing raises
    PluginError for a name that nobody provides, that two provide, or that cannot be imported."""

    def __init__(
        self, group: str, own: Mapping[str, T], fits: Callable[[Any], bool] = callable
    ) -> None:
        self.own, self.group, self._fits = dict(own), group, fits
        self._added: dict[Folders, dict[str, T]] = {}

    def __getitem__(self, name: str) -> T:
        if name in self.own:
            return self.own[name]
        added = self._added.setdefault(active_folders(), {})
        if name not in added:
            added[name] = self._load(name)
        return added[name]

    def __iter__(self) -> Iterator[str]:
        return iter((*self.own, *self._added.get(active_folders(), ())))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def path(self, name: str) -> str | None:
        """Return the `package.module:name` of a plug-in; None: it is ours, or nobody provides it.

        Raises PluginError: two packages provide it, or ours and another one."""
        points = _entry_points(self.group).get(name, [])
        if len(points) + (name in self.own) > 1:
            by = sorted(point.dist.name if point.dist else point.value for point in points)
            by += ["lidarplace"][: name in self.own]
            problem = f"duplicate name in {self.group}, of {' and '.join(by)}"
            raise PluginError(problem, place=name, fix="uninstall all but one")
        if points:
            PLUGINS.setdefault(points[0].module.partition(".")[0], points[0].dist)
            return f"{points[0].module}:{points[0].attr}"
        if name in self.own or ":" not in name:
            return None
        PLUGINS.setdefault(name.partition(":")[0].partition(".")[0], None)
        return name

    def modules(self, names: Iterable[str]) -> tuple[str, ...]:
        """List the modules of the plug-ins among `names`, whose code decides results."""
        paths = (self.path(name) for name in names if name not in self.own)
        return tuple(path.partition(":")[0] for path in paths if path is not None)

    def installed(self) -> dict[str, T]:
        """Return ours and those of all installed packages; warn of each that is broken."""
        plug_ins = dict(self.own)
        for name in _entry_points(self.group):
            try:
                self.path(name)
                plug_ins[name] = self[name]
            except PluginError as error:
                _log.warning("plug-in left out: %s", error)
        return plug_ins

    def calls(self, name: str, *passed: type[Exception]) -> AbstractContextManager[None]:
        """Guard a block that calls the plug-in `name`, see `foreign_code`; no guard for ours."""
        return nullcontext() if name in self.own else foreign_code(name, passed)

    def number(self, name: str, compute: Callable[[], float], of: str) -> float:
        """Compute the number `name` of a rig or class `of`; that of a plug-in must be finite.

        Raises InputError that names both."""
        if name in self.own:
            return compute()
        place = f"{name}: {of}"
        with foreign_code(place):
            value = compute()
        return finite_number(value, place)

    def where(self, place: Callable[[T], float | None]) -> Names:
        """Return names whose `place` is neither None nor False, in the order of their places."""
        return Names(self, place)

    def _load(self, name: str) -> T:
        if (path := self.path(name)) is None:
            raise PluginError(f"no installed package has it among its {self.group}", place=name)
        where = name if name == path else f"{name} ({path})"
        try:
            plug_in = import_plugin(path, where)
        except InputError as error:
            root, fix = path.partition(":")[0].partition(".")[0], ""
            if getattr(error.__cause__, "name", None) == root:
                fix = "put its folder next to the configuration, here, or on PYTHONPATH"
            if root not in sys.modules:
                PLUGINS.pop(root, None)  # nothing to send to a worker
            raise PluginError(error.problem, place=where, fix=fix) from error
        if not self._fits(plug_in):
            expected, kind = f"one of {self.group}", type(plug_in).__name__
            raise PluginError("wrong type", place=where, expected=expected, found=kind)
        return cast(T, plug_in)


@dataclass(frozen=True, eq=False)
class Names(Collection[str]):
    """Some names of a registry, see `Registry.where`; looked up when they are read."""

    registry: Registry[Any]
    place: Callable[[Any], float | None]

    def __iter__(self) -> Iterator[str]:
        return iter(self.among(self.registry))

    def __len__(self) -> int:
        return len(self.among(self.registry))

    def __contains__(self, name: object) -> bool:
        return bool(self.among([str(name)]))

    @property
    def own(self) -> tuple[str, ...]:
        """Names that this package registers."""
        return self.among(self.registry.own)

    def among(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of `names` that are in the registry and have a place, in order."""
        places = {name: self.place(self.registry[name]) for name in names if name in self.registry}
        placed = {name: at for name, at in places.items() if at is not None and at is not False}
        return tuple(sorted(placed, key=lambda name: placed[name]))


@dataclass(frozen=True, eq=False)
class OneOf:
    """Annotation of a string in settings: a name of these kinds, with a tail, or one of others.

    Looked up when it is read; the schema lists what is installed."""

    kinds: tuple[Names, ...]
    others: tuple[str, ...] = ()
    tails: tuple[str, ...] = ("",)

    def names(self) -> tuple[str, ...]:
        """Return all names that are installed."""
        names = (name for kind in self.kinds for name in kind.among(kind.registry.installed()))
        return (*(name + tail for name in names for tail in self.tails), *self.others)

    def check(self, name: str) -> str:
        """Return `name`.

        Raises PluginError for a broken plug-in, PydanticCustomError for another name."""
        broken = None
        for kind, tail in product(self.kinds, self.tails):
            base = name.removesuffix(tail)
            try:
                path = kind.registry.path(base)
                if (path and kind.registry[base] and base in kind) or base in kind.own:
                    return name
            except PluginError as error:
                broken = broken or error
        if name in self.others:
            return name
        if broken:
            raise broken
        *others, last = map(repr, self.names())
        context = {"expected": f"{', '.join(others)} or {last}"}
        raise PydanticCustomError("literal_error", "Input should be {expected}", context)

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(kind))

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(self.names())}, {"pattern": ":"}], "type": "string"}


@cache
def _entry_points(group: str) -> dict[str, list[EntryPoint]]:
    by_name: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=group):
        by_name.setdefault(point.name, []).append(point)
    return by_name
