"""Wrong values in JSON and YAML: a place of the tree is replaced, left out, doubled, wrapped."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import yaml

from tests.fuzz.nasty import TEXTS, value


def places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of the tree with each of its keys or indices."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, inner in list(items):
        yield tree, key
        if isinstance(inner, dict | list):
            yield from places(inner)


def changed(tree: Any, random: Random) -> tuple[Any, str]:
    """Copy the tree with one thing wrong; return it and the change."""
    tree = copy.deepcopy(tree)
    positions = list(places(tree)) if isinstance(tree, dict | list) else []
    if not positions or random.random() < 0.1:
        return value(random), "another document"
    container, key = random.choice(positions)
    change = random.choice(("replaced", "replaced", "replaced", "left out", "wrapped", "renamed"))
    if change == "replaced":
        container[key] = value(random)
    elif change == "left out":
        del container[key]
    elif change == "wrapped":
        container[key] = random.choice(([container[key]], {"a": container[key]}))
    elif isinstance(container, dict):
        container[random.choice((*TEXTS, 1, None, True))] = container.pop(key)
    else:
        container.append(container[key])
    return tree, f"{key!r} {change}"


def json_value(path: Path, random: Random) -> str:
    tree, change = changed(json.loads(path.read_text(encoding="utf-8")), random)
    path.write_text(json.dumps(tree), encoding="utf-8")
    return change


def yaml_value(path: Path, random: Random) -> str:
    tree, change = changed(yaml.safe_load(path.read_text(encoding="utf-8")), random)
    path.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return change


SYNTAX = (
    *("a: [1, 2", "a: 1\na: 2", "\t- a", "!!bool abc", "!!python/object:os.system {}", "%YAML 9"),
    *(
        "a: *b",
        "&a [*a]",
        "--- 1\n--- 2",
        "? {a: 1}\n: 2",
        "[" * 3000,
        "a: !!timestamp x",
        "? []\n",
    ),
    *("a: !!int x", "a: !!float x", "a: 2001-99-99", "<<: 1", "a: !!binary '*'", "!!set {a}"),
)


def yaml_syntax(path: Path, random: Random) -> str:
    text = random.choice(SYNTAX)
    old = path.read_text(encoding="utf-8")
    path.write_text(random.choice((text, f"{old}\n{text}\n", f"{text}\n{old}")), encoding="utf-8")
    return f"syntax {text[:20]!r}"


def json_syntax(path: Path, random: Random) -> str:
    text = random.choice(
        ("", "{", "[" * 3000, "NaN", "1e999", "null", '{"a": 1} x', "\ufeff{}", "'a'")
    )
    path.write_text(text, encoding="utf-8")
    return f"syntax {text[:20]!r}"
