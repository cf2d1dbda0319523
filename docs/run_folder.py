"""Writes docs/run_folder.md from the models of the files: `python docs/run_folder.py`."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

from tracking.run_folders import search_tables, sweep_tables
from tracking.run_folders.arrays import ArrayFile, FailureFrames, Frame, Grounds, Maps, UnseenMaps
from tracking.run_folders.json_file import ResultFile
from tracking.run_folders.search_json import SearchResult
from tracking.run_folders.sweep_json import SweepResult
from tracking.run_folders.table_schema import TableSchema

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# The files of a run folder

A sweep or a search writes these files to `OUTPUT/NAME`. You can read them without lidarplace:
tables are Parquet, arrays are NumPy archives (`numpy.load`), the rest is JSON and YAML. `python
docs/run_folder.py` makes this page from the models that write and check these files.

- Lengths are in metres, angles in radians unless the name ends in `_deg`, AP and recall in percent.
- Any value of a table may be missing. A table without rows has no columns.
- Arrays by class or by placement are called `pog/Car`, `coverage/line`, `unseen/Car/found_1`.
- `config.yaml` is the configuration, overrides included, without passwords.
"""


def page() -> str:
    """The page as it should be."""
    return "\n".join(
        (
            HEAD,
            "## A sweep\n",
            "`rigs.yaml` has its placements and their LiDARs, for the [studio](studio.md).\n",
            *_of_json(SweepResult),
            *(line for table in sweep_tables.TABLES for line in _of_table(table)),
            *_of_arrays(Maps),
            *_of_arrays(Frame),
            *_of_arrays(FailureFrames),
            *_of_arrays(Grounds),
            "## A search\n",
            "`placement.yaml` is the best rig and `sweep.yaml` a sweep of the winners, see",
            "[search](search.md#what-comes-out).\n",
            *_of_json(SearchResult),
            *(line for table in search_tables.TABLES for line in _of_table(table)),
            *_of_arrays(UnseenMaps),
            f"`{Grounds.FILE}` is as that of a sweep.",
        )
    )


def _of_json(model: type[ResultFile]) -> Iterator[str]:
    yield f"### `{model.FILE}`\n"
    yield _rows(
        ("key", ""),
        ((f"`{key}`", field.description or "") for key, field in model.model_fields.items()),
    )


def _of_table(table: TableSchema) -> Iterator[str]:
    yield f"### `{table.file}`\n"
    axes = {(): "", ("",): " The axes of the grid are columns too."}
    own = " and".join(", ".join(f"`{head}`" for head in table.axes).rsplit(",", 1))
    told = axes.get(table.axes, f" Axes of the grid within {own} are columns too.")
    yield f"A row: {table.doc}.{told}\n"
    yield _rows(
        ("column", "type", ""),
        ((f"`{column.name}`", column.dtype or "any", column.doc) for column in table.columns),
    )


def _of_arrays(model: type[ArrayFile]) -> Iterator[str]:
    yield f"### `{model.FILE}`\n"
    text = inspect.cleandoc(model.__doc__ or "")
    about, _, arrays = text.partition("\n\nAttributes:\n")
    yield about + "\n"
    lines = inspect.cleandoc(arrays.replace("\n        ", " ")).splitlines()
    named = (line.strip().partition(": ") for line in lines)
    yield _rows(
        ("arrays", ""),
        ((", ".join(f"`{n}`" for n in names.split(", ")), doc) for names, _, doc in named),
    )


def _rows(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [tuple(head), *(tuple(row) for row in rows)]
    cells = [" | ".join(" ".join(c.split()).replace("|", "\\|") for c in line) for line in lines]
    cells.insert(1, " | ".join(["---"] * len(lines[0])))
    return "\n".join(f"| {line} |" for line in cells) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
