"""YAML that people write: plain data, within limits; duplicate keys are rejected."""

import re
import reprlib
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.parser import ParserError
from yaml.reader import ReaderError
from yaml.resolver import Resolver
from yaml.scanner import ScannerError

from lidarplace.base.errors import InputError, at
from lidarplace.files.regular import regular

MOST_BYTES = 16_000_000
"""Bytes of a file: some 50,000 placements of four mounts; beyond, it is likely another file."""
MOST_VALUES = 5_000_000  # keys and values of a file; what an alias stands for is counted each time
DEEPEST = 100  # mappings and lists inside each other

_TAG = "tag:yaml.org,2002:"
_KINDS = {f"{_TAG}{kind}" for kind in ("null", "bool", "int", "float", "str", "seq", "map")}
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_EXPONENT = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$")


class YamlError(InputError):
    """Problem of a YAML document and its place, in one line."""


if yaml.__with_libyaml__:
    # Ten times as fast: a file may hold thousands of placements.
    from yaml.cyaml import CParser as _Parser  # type: ignore[attr-defined]
else:

    class _Parser(yaml.reader.Reader, yaml.scanner.Scanner, yaml.parser.Parser):  # type: ignore[no-redef]
        def __init__(self, text: str) -> None:
            yaml.reader.Reader.__init__(self, text)
            yaml.scanner.Scanner.__init__(self)
            yaml.parser.Parser.__init__(self)


class _Loader(Composer, _Parser, SafeConstructor, Resolver):
    """Loader that composes nodes in Python, where depth, size and keys can be watched.

    Only numbers, truth values, text, lists and mappings are there: a date is text, and YAML's sets
    and binaries are refused as Python's objects are. `1e-3` is a number, as in YAML 1.2."""

    yaml_constructors = {  # noqa: RUF012 - of PyYAML
        tag: constructor
        for tag, constructor in SafeConstructor.yaml_constructors.items()
        if tag in _KINDS
    }
    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in choices if tag in {*_KINDS, f"{_TAG}merge"}]
        for first, choices in Resolver.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str) -> None:
        _Parser.__init__(self, text)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._depth = self._values = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node; count what is in a value, and how deep it is."""
        event: Any = self.peek_event()
        before = self._values
        self._depth += 1
        self._values += 1
        if self._depth > DEEPEST:
            raise _error(f"more than {DEEPEST} mappings and lists inside each other", event)
        node = super().compose_node(parent, index)
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._sizes:
                raise _error(f"*{event.anchor} stands inside of what it stands for", event)
            self._values += self._sizes[id(node)]
        elif event.anchor is not None:
            self._sizes[id(node)] = self._values - before
        if self._values > MOST_VALUES:
            raise _error(f"more than {MOST_VALUES:,} values, aliases written out", event)
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        """Compose a mapping; of equal keys YAML would silently take the last."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != f"{_TAG}merge":
                value = self.construct_object(key)
                if value in seen:
                    raise _error(f"key {value!r} is given twice", key)
                seen.add(value)
        return node

    def construct_undefined(self, node: Any) -> Any:
        """Reject values with another tag."""
        raise _error(f"tag {reprlib.repr(node.tag)} is not taken", node)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct the value of a node."""
        if isinstance(node, yaml.ScalarNode) and (match := _CONTROL.search(node.value)):
            raise _error(f"control character {match[0]!r} in a text", node)
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError, AttributeError):  # such as `!!bool abc`
            kind = node.tag.removeprefix(_TAG)
            raise _error(f"{reprlib.repr(node.value)} is not a valid {kind}", node) from None


_Loader.add_constructor(None, _Loader.construct_undefined)  # type: ignore[type-var]
_Loader.add_implicit_resolver(f"{_TAG}float", _EXPONENT, list("-+0123456789"))


def parse_yaml(text: str) -> Any:
    """Parse a YAML document, None for an empty one; no two places share an object.

    Raises YamlError: it is none, holds anything but plain data, gives a key twice, or is beyond the
    limits `MOST_VALUES` and `DEEPEST`."""
    try:
        return _unshared(_Loader(text).get_single_data())
    except ReaderError as error:
        lines = text[: error.position].split("\n")
        where = f"line {len(lines)}, column {len(lines[-1]) + 1}"
        raise YamlError(f"is not YAML: {error.reason}", place=where) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        syntax = "is not YAML: " if isinstance(error, (ScannerError, ParserError)) else ""
        problem = str(error.problem)
        if problem.startswith("but "):
            problem = f"{error.context}, {problem}"
        raise YamlError(syntax + " ".join(problem.split()), place=where) from None


def read_yaml_file(path: Path) -> Any:
    """Read a YAML file, as `parse_yaml` does.

    Raises OSError and, naming the file, YamlError; also if it is not text or is too large."""
    with regular(path).open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    with at(path, YamlError):
        if len(content) > MOST_BYTES:
            raise YamlError(f"has more than {MOST_BYTES:,} bytes")
        try:
            return parse_yaml(content.decode("utf-8-sig"))
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise YamlError("is not UTF-8 text", place=f"line {line}") from None


def _error(problem: str, at: Any) -> ConstructorError:
    return ConstructorError(None, None, problem, at.start_mark)


def _unshared(value: Any) -> Any:
    """Copy a value so that no two places share what an alias stands for."""
    if isinstance(value, dict):
        return {key: _unshared(inner) for key, inner in value.items()}
    return [_unshared(inner) for inner in value] if isinstance(value, list) else value
