"""A version of the code that a function can run: what else is edited leaves results cached.

From a function, every definition that its names lead to is followed through the packages of this
project and of plug-ins: functions, classes, constants, numba kernels, imports within functions.
Hashed is their syntax tree, see `sweeps.tasks.source`. Definitions are distinguished by what
they say and by what their names lead to, not by the file that they are in: moving one to another
file, with the imports that this takes, changes nothing.

What Python finds out only as it runs is answered for all it can be: a class counts with all its
methods, and a module imported by a name put together at run time as every module that it can be,
unless a root says which. Versions of other packages do not count.
"""

import hashlib
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from lidarplace.base.errors import InputError
from sweeps import PACKAGES
from sweeps.tasks.source import Definition, Source, read_source

_Node = tuple[str, str | None]
"""Module and name; None: what importing the module does besides."""
_Edges = dict[_Node, set[tuple[str, _Node | str]]]
"""Of every node that counts the names in it, each with its node, or its path if it is not ours."""


class Code:
    """The sources of some packages, name -> folder, or the file of a module; each is read once."""

    def __init__(self, packages: Mapping[str, Path]) -> None:
        self._packages = dict(packages)
        self._files = dict(chain.from_iterable(map(_files, packages, packages.values())))
        self._sources: dict[str, Source] = {}

    def version(self, *roots: str) -> str:
        """Hash of all that `roots` can run: dotted paths of functions, classes, constants or
        modules. A module counts as a whole, and with a function the types that its arguments are
        annotated with. A root in a package of which a module is imported by a name put together at
        run time says that it is this one. Raises ValueError: a path leads nowhere, or a source
        imports in a way that is not followed."""
        edges = self._closure(roots)
        colours: dict[_Node | str, str] = {node: self._definition(node).says for node in edges}
        # Colour refinement: nodes that say the same differ if what their names lead to differs.
        while True:
            refined: dict[_Node | str, str] = {}
            for node, uses in edges.items():
                leads = sorted(f"{name} {colours.get(to, str(to))}" for name, to in uses)
                refined[node] = _hash(colours[node], *leads)
            settled = len(set(refined.values())) == len(set(colours.values()))
            colours = refined
            if settled:
                first = {colours[node] for root in roots for node in self._nodes(root)}
                return _hash(*sorted(first), *sorted(set(colours.values())))

    def _closure(self, roots: Collection[str]) -> _Edges:
        edges: _Edges = {}
        run: set[str] = set()
        first = set[_Node]()
        for root in roots:
            if not (nodes := set(self._nodes(root))):
                raise InputError(f"is not in {', '.join(self._packages)}", place=root)
            first |= nodes
        open_ = list(first)
        while open_:
            node = open_.pop()
            if node in edges:
                continue
            edges[node] = set()
            definition = self._definition(node)
            for module in (node[0], *definition.runs):
                open_ += self._effects_of_running(module, run)
            takes = definition.takes if node in first else frozenset()
            for name, path in definition.uses | takes:
                if path.endswith("*") and any(root.startswith(path[:-1]) for root in roots):
                    continue
                ours = list(self._nodes(path))
                edges[node] |= {(name, to) for to in ours} or {(name, path)}
                open_ += ours
        return edges

    def _effects_of_running(self, path: str, run: set[str]) -> list[_Node]:
        """What else runs when a module is imported, but for modules in `run`, which it joins."""
        open_, found = [path], list[_Node]()
        while open_:
            for module in self._modules_on(open_.pop()):
                if module not in run:
                    run.add(module)
                    source = self._source(module)
                    open_ += source.runs
                    found += [(module, None)] if source.effects else []
        return found

    def _nodes(self, path: str) -> Iterator[_Node]:
        """What a dotted path leads to: one definition, all of a module, nothing if not ours."""
        package, *_ = path.split(".")
        if package not in self._packages:
            return
        if path.endswith(".*"):
            _, *inner = path[:-2].split(".")
            for file in sorted(self._packages[package].joinpath(*inner).glob("[!_]*.py")):
                yield from self._nodes(f"{path[:-2]}.{file.stem}")
            return
        module = self._modules_on(path)[-1]
        source = self._source(module)
        name, _, rest = path.removeprefix(module).removeprefix(".").partition(".")
        if name in source.definitions:
            yield module, name
        elif name in source.imports:
            yield from self._nodes(".".join(filter(None, [source.imports[name], rest])))
        elif name:
            raise InputError(f"there is no {name} in {self._files[module]}", place=path)
        else:
            yield from ((module, own) for own in source.definitions)
            for target in source.imports.values():
                if target not in self._files:
                    yield from self._nodes(target)

    def _modules_on(self, path: str) -> list[str]:
        """The modules of ours among a dotted path and its parents, outermost first."""
        parts = path.removesuffix(".*").split(".")
        paths = [".".join(parts[:count]) for count in range(1, len(parts) + 1)]
        return [module for module in paths if module in self._files]

    def _definition(self, node: _Node) -> Definition:
        module, name = node
        source = self._source(module)
        found = source.definitions[name] if name else source.effects
        assert found is not None
        return found

    def _source(self, module: str) -> Source:
        if module not in self._sources:
            self._sources[module] = read_source(self._files[module], module)
        return self._sources[module]


def _files(package: str, folder: Path) -> Iterator[tuple[str, Path]]:
    """The modules of a package by their dotted paths; a folder comes after a file of its name."""
    if folder.is_file():
        yield package, folder
    for path in sorted(folder.rglob("*.py"), key=lambda path: path.name == "__init__.py"):
        parts = path.relative_to(folder).with_suffix("").parts
        yield ".".join([package, *parts]).removesuffix(".__init__"), path


@cache
def code_version(*roots: str) -> str:
    """`Code.version` of the sources that this process runs: ours, and the packages of `roots`."""
    packages = dict.fromkeys((*PACKAGES, *(root.partition(".")[0] for root in roots)))
    return _code(*packages).version(*roots)


@cache
def _code(*packages: str) -> Code:
    return Code({name: place_of(name) for name in packages})


def place_of(package: str) -> Path:
    """Its folder, or the file of a module without one. Raises ValueError if it has no source."""
    spec = find_spec(package)
    places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin or ""]
    if not places or not Path(places[0]).exists():
        raise InputError("no source files", place=package, expected="a Python package or module")
    return Path(places[0])


def _hash(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
