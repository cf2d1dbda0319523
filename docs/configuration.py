"""Writes docs/configuration.md from the models: `python docs/configuration.py`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.studio.rigs_file import RigsSettings
from sweeps.configuration.requirements_file import RequirementsFile
from sweeps.configuration.search import SearchFile
from sweeps.configuration.sweep import SweepFile

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# Configuration

This page lists every key of the files of sweeps, searches, requirements and studios. `python
docs/configuration.py` makes it from the models that validate the files.

- A key path such as `scene.density` names a key in nested mappings. Use it as an axis of `grid`, as
a column of the results, and in `--set scene.density=40`. - An unknown key is an error that suggests
the nearest one. A value out of range is an error, even if an axis of `grid` replaces it. `true` and
`"3"` are not numbers. - Two axes may not overlap: `scene` together with `scene.density` is
rejected. - A file is YAML of numbers, texts, lists and mappings, at most 16 MB; `1e-3` is a number,
a date is text, other tags are rejected. Aliases are copied, so `--set` changes one place. - `NAME`
is any name, `[]` stands for each entry of a list. - Ego frame: x forward, y left, z up; metres.
Angles are radians, unless the key ends in `_deg`. - `lidarplace run --schema` prints the same as a
JSON schema, for editors that complete YAML.

How the keys are used: [long sweeps](sweeps.md), [search](search.md), [data](data.md),
[detectors](detectors.md), [method](method.md), [requirements](requirements.md),
[studio](studio.md).
"""

Schema = dict[str, Any]

NEEDED = {"name": "the file's name", "placement": "needed, here or in `grid`"}
"""Keys that a model requires and a file need not have."""


@dataclass(frozen=True)
class Section:
    """The keys of one mapping: its path in a file and its schema."""

    path: str
    schema: Schema

    @property
    def title(self) -> str:
        source = self.schema["properties"].get("source", {}).get("const")
        if not self.path:
            return "a sweep's file"
        return f"`{self.path}`" + (f", source: {source}" if source else "")

    @property
    def anchor(self) -> str:
        """As GitHub makes it of the title."""
        return re.sub(r"[^\w -]", "", self.title.lower()).replace(" ", "-")


def page() -> str:
    """The page as it should be."""
    parts, told = [HEAD], []
    for title, model, path in (
        ("A sweep's file", SweepFile, ""),
        ("A search's file", SearchFile, ""),
        ("A file of requirements", RequirementsFile, ""),
        ("A studio's file", RigsSettings, ""),
        ("A CARLA collection's file", CarlaScene, "scene"),
    ):
        parts.append(f"## {title}\n")
        schema = model.model_json_schema()
        _tell(Section(path, schema), schema.get("$defs", {}), told, parts)
    return "\n".join(parts)


def _tell(section: Section, definitions: Schema, told: list[Section], parts: list[str]) -> None:
    """Append a mapping's table, then the mappings inside it, each once."""
    if section in told:
        return
    twin, same = _twin(section, told)
    told.append(section)
    # What tells kinds of a mapping apart comes first, though a model inherits keys before it.
    fields = sorted(section.schema["properties"], key=lambda key: key != "source")
    if section.path:
        parts += [f"### {section.title}\n", _description(section.schema) + "\n"]
    if twin:
        names = ", ".join(f"`{key}`" for key in fields if key in same)
        parts.append(f"As in [{twin.title}](#{twin.anchor}): {names}.\n")
    own = [key for key in fields if key not in same]
    if own:
        parts.append("| key | value | default | |\n|---|---|---|---|")
        parts += [_row(section, key, definitions) for key in own]
        parts[-1] += "\n"
    for key in own:
        field = section.schema["properties"][key]
        for inner in _inner(field, _join(section.path, key), definitions):
            _tell(inner, definitions, told, parts)


def _inner(field: Schema, path: str, definitions: Schema) -> Iterator[Section]:
    """The mappings that a field may hold."""
    if "$ref" in field:
        yield Section(path, definitions[field["$ref"].rpartition("/")[2]])
    for choice in (*field.get("anyOf", ()), *field.get("oneOf", ())):
        yield from _inner(choice, path, definitions)
    if "items" in field:
        yield from _inner(field["items"], path + "[]", definitions)
    if isinstance(field.get("additionalProperties"), dict):
        yield from _inner(field["additionalProperties"], path + ".NAME", definitions)


def _twin(section: Section, told: list[Section]) -> tuple[Section | None, set[str]]:
    """The earlier section with most of the same keys, if there are five or more, and these keys."""
    fields = section.schema["properties"]
    twin, most = None, set[str]()
    for other in told:
        theirs = other.schema["properties"]
        same = {key for key in fields if fields[key] == theirs.get(key)}
        if len(same) >= max(5, len(most) + 1):
            twin, most = other, same
    return twin, most


def _row(section: Section, key: str, definitions: Schema) -> str:
    field, path = section.schema["properties"][key], _join(section.path, key)
    if key in section.schema.get("required", ()):
        default = NEEDED.get(path, "needed")
    else:
        default = _default(field)
    cells = (f"`{path}`", _value(field, path, definitions), default, field["description"])
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def _value(field: Schema, path: str, definitions: Schema) -> str:
    """What a value may be, with its limits; a link where it is a mapping of keys."""
    if "$ref" in field:
        return f"[keys](#{next(_inner(field, path, definitions)).anchor})"
    if choices := (*field.get("anyOf", ()), *field.get("oneOf", ())):
        return " or ".join(_value(choice, path, definitions) for choice in choices)
    if "const" in field or "enum" in field:
        return ", ".join(f"`{value}`" for value in field.get("enum", [field.get("const")]))
    if "prefixItems" in field:
        items = [_value(item, path, definitions) for item in field["prefixItems"]]
        limits = {_limits(item) for item in field["prefixItems"]}
        if len(limits) == 1:  # told once
            items = [item.removesuffix(*limits) for item in items]
            return f"[{', '.join(items)}]{limits.pop()}"
        return f"[{', '.join(items)}]"
    name = field.get("type", "any")
    if name == "array":
        least = " (at least one)" if field.get("minItems") == 1 else ""
        return f"list of {_value(field['items'], path + '[]', definitions)}{least}"
    if name == "object":
        inner = field.get("additionalProperties")
        names = field.get("propertyNames", {}).get("enum", [])
        keys = ", ".join(f"`{n}`" for n in names) or "name"
        if not isinstance(inner, dict):
            return "mapping"
        return f"mapping: {keys} → {_value(inner, path + '.NAME', definitions)}"
    if name == "string":
        return "path" if field.get("format") == "path" else "text"
    return {"integer": "whole number", "boolean": "true, false"}.get(name, name) + _limits(field)


def _limits(field: Schema) -> str:
    """The range of a number; of two limits, of its kind and its own, the narrower one."""
    lower, upper = ("minimum", "exclusiveMinimum"), ("exclusiveMaximum", "maximum")
    lows = [(field[key], key == lower[1]) for key in lower if key in field]
    highs = [(field[key], key == upper[1]) for key in upper if key in field]
    (low, above), (high, included) = max(lows, default=("", 0)), min(highs, default=("", 0))
    if lows and highs and included and not above:
        return f" {_short(low)} to {_short(high)}"
    limits = [f"{'>' if above else '≥'} {_short(low)}"] if lows else []
    limits += [f"{'≤' if included else '<'} {_short(high)}"] if highs else []
    return f" {', '.join(limits)}" if limits else ""


def _short(number: float) -> str:
    return f"{int(number):,}" if number == int(number) else f"{number:.6g}"


def _default(field: Schema) -> str:
    value = field.get("default")
    if isinstance(value, dict) and "additionalProperties" not in field:
        return "their own"
    return f"`{_yaml(value)}`"


def _yaml(value: Any) -> str:
    """A value as one would write it in YAML, on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {_yaml(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    if isinstance(value, str):
        return value
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)


def _description(schema: Schema) -> str:
    """The docstring of a model, without what it raises."""
    paragraphs = schema["description"].split("\n\n")
    text = " ".join(part for part in paragraphs if not part.startswith("Raises"))
    return " ".join(text.split())


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
