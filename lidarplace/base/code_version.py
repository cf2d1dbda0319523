"""Versions of code: what compiled kernels and stored results are named after, so none is stale.

The version of a module is a hash of its syntax tree and of those of all modules of this project and
of plug-ins that it imports, directly or through others, also within functions. Comments,
docstrings, annotations of functions and descriptions of pydantic's fields do not count. A name that
a package passes on from one of its modules leads to that module alone. Versions of other packages
do not count."""

import ast
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec, resolve_name
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.base.plugin_folders import Folders, active_folders

OMIT_DEFAULT = "omit default"
"""Metadata of a field that is in the key of a result only if it differs from its default."""
PACKAGES = ("lidarplace", "training", "tracking", "sweeps")
"""The packages of this project."""

_Import = tuple[str, str | None]
"""A module, and the name that is imported from it, if any."""
_Places = tuple[tuple[str, Path], ...]
"""Packages, and their folders or files."""
_UNREAD = {"annotation", "returns", "ctx", "type_comment"}


def code_version(*modules: str) -> str:
    """Hash the code that modules can run, by their dotted paths; see `Sources.version`."""
    return _version(_places_of(modules), modules)


def changed_since(moment: float, *modules: str) -> bool:
    """Whether code that modules can run has changed on the disk; see `Sources.changed_since`."""
    return _sources(_places_of(modules)).changed_since(moment, *modules)


def _places_of(modules: tuple[str, ...]) -> _Places:
    """Return the packages that Python imports now: plug-ins of other folders have their version."""
    packages = dict.fromkeys((*PACKAGES, *(module.partition(".")[0] for module in modules)))
    return _places(tuple(packages), active_folders())


@cache
def _places(packages: tuple[str, ...], folders: Folders) -> _Places:
    return tuple((name, place_of(name)) for name in packages)


@cache
def _version(places: _Places, modules: tuple[str, ...]) -> str:
    return _sources(places).version(*modules)


@cache
def _sources(places: _Places) -> "Sources":
    return Sources(dict(places))


def forget_versions() -> None:
    """Read sources anew, as they may have changed since this process started."""
    for cached in (_places, _version, _sources):
        cached.cache_clear()


def place_of(package: str) -> Path:
    """Return the folder of a package, or the file of a module without one.

    Raises InputError: there is no source."""
    spec = find_spec(package)
    places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin or ""]
    if not places or not Path(places[0]).exists():
        raise InputError("no source files", place=package, expected="a Python package or module")
    return Path(places[0])


class Sources:
    """The source files of packages, each read once.

    `packages`: name -> folder, or the file of a module without one."""

    def __init__(self, packages: Mapping[str, Path]) -> None:
        self._packages = dict(packages)
        self._file, self._source = cache(self._locate), cache(self._read)
        self._digests = cache(self._reach)

    def version(self, *modules: str) -> str:
        """Hash `modules` and all that they import of the packages.

        Where a module imports another by a name put together at run time, every module that it can
        be counts, unless one of `modules` says which. Raises InputError: a module does not exist,
        or imports in a way that cannot be followed."""
        digests = sorted(self._digests(*modules).items())
        return hashlib.sha256(repr(digests).encode()).hexdigest()

    def changed_since(self, moment: float, *modules: str) -> bool:
        """Whether a file behind `version` has changed since a moment, seconds since 1970."""
        files = filter(None, map(self._file, self._digests(*modules)))
        return any(file.stat().st_ctime > moment for file in files)

    def _reach(self, *modules: str) -> dict[str, str]:
        """Return the digests of `modules` and of all that they import, by name."""
        digests: dict[str, str] = {}
        queue: list[str] = []
        for module in modules:
            if self._file(module) is None:
                raise InputError("no such module", place=module)
            queue.append(module)
        while queue:
            name = queue.pop()
            if name in digests:
                continue
            source = self._source(name)
            digests[name] = source.digest
            for imported in source.imports:
                queue += self._definers(*imported)
            for prefix in source.prefixes:
                if not any(module.startswith(prefix) for module in modules):
                    queue += self._below(prefix)
        return digests

    def _definers(self, module: str, name: str | None) -> Iterator[str]:
        """List the module that an import leads to; none if it is not of the packages."""
        file = self._file(module)
        if name is not None and self._file(f"{module}.{name}") is not None:
            yield f"{module}.{name}"
        elif file is not None and file.name == "__init__.py" and name is not None:
            passed_on = self._source(module).passed_on.get(name)
            yield from [module] if passed_on is None else self._definers(*passed_on)
        elif file is not None:
            yield module

    def _below(self, prefix: str) -> list[str]:
        """List the modules of the package `prefix`, which ends in a dot."""
        package, *inner = prefix.removesuffix(".").split(".")
        files = self._packages[package].joinpath(*inner).glob("[!_]*.py")
        return [prefix + file.stem for file in sorted(files)]

    def _locate(self, module: str) -> Path | None:
        package, *inner = module.split(".")
        if (place := self._packages.get(package)) is None:
            return None
        if place.is_file():
            return None if inner else place
        place = place.joinpath(*inner)
        return next(filter(Path.is_file, (place.with_suffix(".py"), place / "__init__.py")), None)

    def _read(self, module: str) -> "_Source":
        file = self._file(module)
        assert file is not None
        package = module if file.name == "__init__.py" else module.rpartition(".")[0]
        return _parse(str(file), package, file.read_bytes())


@dataclass(frozen=True)
class _Source:
    """Imports and digest of a source file.

    `digest`: hash of its syntax tree. `passed_on`: names that it imports at its top level.
    `prefixes`: packages, each with a dot at its end, of which it imports modules by names that are
    put together at run time."""

    digest: str
    imports: frozenset[_Import]
    passed_on: Mapping[str, _Import]
    prefixes: frozenset[str]


@cache
def _parse(file: str, package: str, content: bytes) -> _Source:
    tree = ast.parse(content, filename=file)
    reader = _Reader(file, package)
    digest = hashlib.sha256(reader.text(tree).encode("utf-8", "surrogatepass")).hexdigest()
    passed_on = dict[str, _Import]()
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom):
            passed_on |= reader.names_of(statement)
    return _Source(digest, frozenset(reader.imports), passed_on, frozenset(reader.prefixes))


class _Reader:
    """Writes syntax trees without what cannot change a result, and notes what they import.

    The text is the same in all versions of Python."""

    def __init__(self, file: str, package: str) -> None:
        self.imports, self.prefixes = set[_Import](), set[str]()
        self._file, self._package = file, package

    def text(self, node: object, in_class: bool = False) -> str:
        annotation = ""
        match node:
            case list():
                texts = [self.text(item, in_class) for item in node]
                return "[" + ",".join(filter(None, texts)) + "]"
            case ast.Constant():
                return f"{type(node.value).__name__} {node.value!r}"
            case (
                ast.Expr(value=ast.Constant(value=str()))
                | ast.If(test=ast.Name(id="TYPE_CHECKING"))
                | ast.keyword(arg="description")
            ):
                return ""
            case ast.Import():
                self.imports |= {(alias.name, None) for alias in node.names}
            case ast.ImportFrom():
                self.imports |= set(self.names_of(node).values())
            case ast.Call(func=ast.Name(id=called) | ast.Attribute(attr=called)):
                if called in ("import_module", "__import__"):
                    self._follow_import(called, node)
            case ast.AnnAssign() if in_class:  # dataclasses and pydantic read them
                annotation = self.text(node.annotation)
            case ast.AnnAssign(value=ast.expr() as assigned):
                return self.text(ast.Assign([node.target], assigned))
            case ast.AnnAssign():
                return ""
            case ast.AST():
                pass
            case _:
                return repr(node)
        inside = isinstance(node, ast.ClassDef)
        fields = (
            f"{name}={self.text(value, inside)}"
            for name in node._fields
            if name not in _UNREAD and (value := getattr(node, name, None)) not in (None, [])
        )
        return f"{type(node).__name__}{annotation}({','.join(fields)})"

    def names_of(self, node: ast.ImportFrom) -> dict[str, _Import]:
        """Return the names that an import binds, each with what it stands for."""
        module = resolve_name("." * node.level + (node.module or ""), self._package)
        return {alias.asname or alias.name: (module, alias.name) for alias in node.names}

    def _follow_import(self, called: str, node: ast.Call) -> None:
        match node.args:
            case [ast.Constant(value=str(module)), *_]:
                self.imports.add((module, None))
            case [ast.JoinedStr(values=[ast.Constant(value=str(prefix)), _]), *_]:
                self.prefixes.add(prefix)
            case _:
                problem = f"{called} of a name that the source does not say"
                raise InputError(problem, place=self._file, key=f"line {node.lineno}")
