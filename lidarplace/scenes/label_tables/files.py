"""Label files as tables: CSV, Parquet, JSON lines, and folders of JSON files, one a frame."""

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import read_text
from lidarplace.files.json_file import read_json
from lidarplace.scenes.datasets.tabular import read_table

LINES = (".jsonl", ".ndjson")
DEEPEST = 8  # levels of an object
MOST_VALUES = 16  # of a list: longer ones are no part of a box
FILE, FOLDER = "file", "folder"
"""Columns of a folder of frames: the number of a file, and its folder below the one read."""


def read_label_file(path: Path, texts: Iterable[str]) -> pd.DataFrame:
    """Read a label file as a table, a row a box; `texts` are columns in which `007` stays text.

    Nested values of JSON are columns such as `position.x`, of lists `position.0`. Of a folder each
    `.json` is a frame: a list of objects, or one that has such a list, as labelCloud and
    SUSTechPOINTS write them; a file without objects is a row without a box. Labels of
    rows are for `row_name`. Raises ValueError if a file cannot be read, or is none of these."""
    labels = None
    if path.is_dir():
        labels, rows = zip(*_rows_of_folder(path), strict=True)
    elif path.suffix.lower() in LINES:
        rows = list(_rows_of_lines(path))
    elif path.suffix.lower() == ".json":
        rows = _objects(read_json(path), path)
    else:
        return read_table(path, texts)
    table = pd.DataFrame(rows, labels)
    for name in {*texts} & {*table.columns}:
        table[name] = table[name].map(_as_text)
    return table


def _as_text(value: object) -> object:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _rows_of_lines(path: Path) -> Iterator[dict[str, Any]]:
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip():
            continue
        place = f"{path}: line {number}"
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"not JSON: {str(error)[:100]}", place=place) from None
        if not isinstance(row, dict):
            raise InputError(place=place, expected="an object", found=type(row).__name__)
        yield _flat(row)


def _rows_of_folder(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the rows, each with its label."""
    paths = sorted(folder.rglob("[!._]*.json"))
    if not paths:
        raise InputError(place=folder, expected="a file .json for each frame")
    numbers = _numbers([path.stem for path in paths])
    path_of: dict[tuple[Path, float], Path] = {}
    for path, number in zip(paths, numbers, strict=True):
        if (other := path_of.setdefault((path.parent, number), path)) != path:
            fix = "keep the files of one frame, and one way to number them"
            raise InputError(f"frame {number} is {other.name}, too", place=path, fix=fix)
        inside = path.parent.relative_to(folder)
        of_file = {FILE: number} | ({FOLDER: inside.as_posix()} if inside.parts else {})
        for row, box in enumerate(_objects(read_json(path), path)):
            yield f"{path.relative_to(folder)}: row {row}", box | of_file


def _numbers(stems: list[str]) -> list[float] | list[int]:
    """Return numbers of frames: of their names if all are numbers or end in one, else in order."""
    plain = pd.to_numeric(pd.Series(stems), errors="coerce")
    if plain.notna().all():
        return plain.tolist()
    ends = [re.search(r"\d{1,15}$", stem) for stem in stems]
    return [int(end[0]) for end in ends if end] if all(ends) else list(range(len(stems)))


def _objects(content: Any, path: Path) -> list[dict[str, Any]]:
    """Return the objects of a JSON file as rows, with the single values next to their list.

    A file without objects is a row of these values."""
    of_file: dict[str, Any] = {}
    if isinstance(content, dict):
        lists = [key for key, value in content.items() if _is_list_of_objects(value)]
        if len(lists) != 1:
            names = ", ".join(lists) or "none"
            raise InputError(place=path, expected="one list of objects", found=names)
        of_file = _flat({key: value for key, value in content.items() if key != lists[0]})
        content = content[lists[0]]
    if not _is_list_of_objects(content):
        raise InputError(place=path, expected="a list of objects")
    return [of_file | _flat(row) for row in content or [{}]]


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(row, dict) for row in value)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Return nested values under one name each, `position.x`; deeper and longer ones are left."""
    flat: dict[str, Any] = {}
    rest: list[tuple[str, Any, int]] = [("", row, 0)]
    while rest:
        name, value, depth = rest.pop()
        if isinstance(value, list) and len(value) <= MOST_VALUES:
            value = dict(enumerate(value))
        if isinstance(value, dict) and depth < DEEPEST:
            start = f"{name}." if name else ""
            rest += [(f"{start}{key}", part, depth + 1) for key, part in value.items()]
        elif not isinstance(value, dict | list):
            flat[name] = value
    return dict(reversed(flat.items()))
