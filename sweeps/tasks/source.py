"""A source file, taken apart into what its names say to Python and what they refer to.

That is their syntax trees without comments, docstrings, descriptions of pydantic's fields,
annotations, and without the methods that only show an object to a person. Annotations in the body
of a class stay: dataclasses and pydantic read them.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError, at


@dataclass(frozen=True)
class Definition:
    """What a name of a module stands for. `says`: hash of the statements that define it. `uses`:
    (name as written, dotted path) of what it refers to. A path that ends in ".*" is any module of a
    package. `takes`: the same of the annotations of a function's arguments. `runs`: dotted paths of
    what it imports."""

    says: str
    uses: frozenset[tuple[str, str]]
    takes: frozenset[tuple[str, str]]
    runs: frozenset[str]


@dataclass(frozen=True)
class Source:
    """A module: definitions by name, dotted paths of names that it has from elsewhere, of what it
    imports, and what importing it does besides, such as setting a flag of a library."""

    definitions: Mapping[str, Definition]
    imports: Mapping[str, str]
    runs: frozenset[str]
    effects: Definition | None


def read_source(path: Path, module: str) -> Source:
    """Take the file of a module apart. Raises ValueError for an import that cannot be followed."""
    return _taken_apart(path, module, path.read_bytes())


@cache
def _taken_apart(path: Path, module: str, content: bytes) -> Source:
    bound: dict[str, list[ast.stmt]] = {}
    imports: dict[str, str] = {}
    runs: set[str] = set()
    others: list[ast.stmt] = []
    for statement in ast.parse(content, filename=str(path)).body:
        if isinstance(statement, ast.ClassDef):  # without what no result depends on
            statement.body = [s for s in statement.body if getattr(s, "name", None) not in _SHOWS]
        if isinstance(statement, ast.Import | ast.ImportFrom):
            imports |= _imported(statement)
            runs |= _modules_run(statement)
        elif not _never_runs(statement):
            names = set(_bound_by(statement))
            for name in names:
                bound.setdefault(name, []).append(statement)
            others += [] if names else [statement]
    effects: list[ast.stmt] = []
    for statement in others:
        # What changes an object of the same module counts where that object does.
        changed = _changed_by(statement)
        bound.get(changed or "", effects).append(statement)
    paths = imports | {name: f"{module}.{name}" for name in bound}
    with at(path):
        return Source(
            definitions={name: _definition(found, paths) for name, found in bound.items()},
            imports=imports,
            runs=frozenset(runs),
            effects=_definition(effects, paths) if effects else None,
        )


_SHOWS = {"__repr__", "_repr_html_", "plot"}
"""Methods whose text or figure is for a person."""


def _never_runs(statement: ast.stmt) -> bool:
    """A text, what only type checkers or a call as a program see, or how figures are drawn."""
    match statement:
        case ast.Expr(value=ast.Constant() | ast.Call(func=ast.Name(id="draw_with"))):
            return True
        case ast.If(test=ast.Name(id="TYPE_CHECKING"), orelse=[]):
            return True
        case ast.If(test=ast.Compare(left=ast.Name(id="__name__")), orelse=[]):
            return True
    return False


def _bound_by(statement: ast.stmt) -> Iterator[str]:
    """Names of the module that a statement gives a meaning to."""
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
            yield statement.name
        case ast.Import() | ast.ImportFrom():
            yield from _imported(statement)
        case ast.Assign() | ast.AnnAssign() | ast.AugAssign():
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            for target in targets:
                names = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
                yield from (name.id for name in names if isinstance(name, ast.Name))
        case _:
            for inner in ast.iter_child_nodes(statement):
                for own in inner.body if isinstance(inner, ast.ExceptHandler) else [inner]:
                    if isinstance(own, ast.stmt):
                        yield from _bound_by(own)


def _changed_by(statement: ast.stmt) -> str | None:
    """The object whose attribute or item a statement sets, or whose method it calls."""
    node: ast.AST
    match statement:
        case ast.Assign(targets=[target]) | ast.AugAssign(target=target):
            node = target
        case ast.Expr(value=ast.Call(func=ast.Attribute() as called)):
            node = called
        case _:
            return None
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else None


def _imported(statement: ast.Import | ast.ImportFrom) -> dict[str, str]:
    if isinstance(statement, ast.ImportFrom):
        return {a.asname or a.name: f"{statement.module}.{a.name}" for a in statement.names}
    named = {a.asname: a.name for a in statement.names if a.asname}
    packages = (a.name.partition(".")[0] for a in statement.names if not a.asname)
    return named | {name: name for name in packages}


def _definition(statements: Sequence[ast.stmt], paths: Mapping[str, str]) -> Definition:
    imports = [found for statement in statements for found in _imports_in(statement)]
    known = reduce(or_, map(_imported, imports), {**paths})
    speech, types = _Speech(known), _Speech(known)
    said = "\n".join(speech.of(statement) for statement in statements)
    digest = hashlib.sha256(said.encode("utf-8", "surrogatepass")).hexdigest()
    for statement in statements:
        if isinstance(statement, ast.FunctionDef):
            for node in ast.walk(statement.args):
                if isinstance(node, ast.arg) and node.annotation is not None:
                    types.of(node.annotation)
    runs = frozenset(speech.runs.union(*map(_modules_run, imports)))
    return Definition(digest, frozenset(speech.uses), frozenset(types.uses), runs)


def _imports_in(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements, those within functions too; no expression has one."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield node
    for inner in ast.iter_child_nodes(node):
        if isinstance(inner, ast.stmt | ast.excepthandler | ast.match_case):
            yield from _imports_in(inner)


_NOT_SAID = {"annotation", "returns", "ctx", "type_comment"}


class _Speech:
    """Writes syntax trees as text, the same for all versions of Python, and notes references, by
    the dotted paths of names. A local name that is called as one of the module counts as that one:
    too much is safe."""

    def __init__(self, paths: Mapping[str, str]) -> None:
        self.uses: set[tuple[str, str]] = set()
        self.runs: set[str] = set()
        self._paths = paths

    def of(self, node: Any, in_class: bool = False) -> str:
        match node:
            case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant(value=str())):
                return ""
            case ast.AnnAssign(value=None) if not in_class:
                return ""
            case ast.AnnAssign(value=ast.expr() as value) if not in_class:
                return self.of(ast.Assign([node.target], value))
            case ast.AnnAssign():
                return f"{self.of(node.annotation)}:{self.of(node.target)}={self.of(node.value)}"
            case ast.Constant():
                return f"{type(node.value).__name__} {node.value!r}"
            case ast.Name() | ast.Attribute():
                self._refer_to(node)
            case ast.Call():
                self._follow_import(node)
                if isinstance(node.func, ast.Name) and node.func.id == "Field":
                    told = [k for k in node.keywords if k.arg != "description"]
                    node = ast.Call(node.func, node.args, told)
            case list():
                return "[" + ",".join(filter(None, (self.of(i, in_class) for i in node))) + "]"
            case ast.AST():
                pass
            case _:
                return repr(node)
        inside = isinstance(node, ast.ClassDef)
        fields = (
            f"{name}={self.of(value, inside)}"
            for name, value in ast.iter_fields(node)
            if name not in _NOT_SAID and value not in (None, [])
        )
        return f"{type(node).__name__}({','.join(fields)})"

    def _refer_to(self, node: ast.Name | ast.Attribute) -> None:
        attributes: list[str] = []
        root: ast.expr = node
        while isinstance(root, ast.Attribute):
            attributes.insert(0, root.attr)
            root = root.value
        if isinstance(root, ast.Name) and root.id in self._paths:
            name, path = root.id, self._paths[root.id]
            self.uses.add((".".join([name, *attributes]), ".".join([path, *attributes])))

    def _follow_import(self, node: ast.Call) -> None:
        """Note what `import_module` brings in."""
        match node.func:
            case ast.Name(id=last) | ast.Attribute(attr=last):
                pass
            case _:
                return
        if not last.endswith(("import_module", "__import__")):
            return
        called = ast.unparse(node.func)
        match node.args:
            case [ast.Constant(value=str(path))]:
                self.runs.add(path)
            case [
                ast.JoinedStr(values=[ast.Constant(value=str(prefix)), ast.FormattedValue()])
            ] if prefix.endswith("."):
                path = f"{prefix}*"
            case _:
                problem = f"{called} of what the source does not say"
                raise InputError(problem, place=f"line {node.lineno}")
        self.uses.add((called, path))


def _modules_run(statement: ast.Import | ast.ImportFrom) -> set[str]:
    if isinstance(statement, ast.ImportFrom):
        return set(_imported(statement).values())  # modules among their parents, too
    return {alias.name for alias in statement.names}
