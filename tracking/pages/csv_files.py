"""The raw numbers of a report's tables: a folder of CSV files."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lidarplace.files.csv import write_csv
from tracking.pages.section import Section

FOLDER = "tables"


def write_csv_files(folder: Path, sections: Sequence[Section]) -> None:
    """Write every table that has data to `folder`/NAME.csv, and remove other CSV files there.

    Each file appears in one step. Two tables of one name get a number each, which the tables of
    `sections` then have in their names too.
    """
    folder.mkdir(exist_ok=True)
    taken: set[str] = set()
    for section in sections:
        for i, table in enumerate(section.tables):
            if table.data is None:
                continue
            name, count = table.name, 1
            while name in taken:
                count += 1
                name = f"{table.name}-{count}"
            taken.add(name)
            section.tables[i] = replace(table, name=name)
            write_csv(table.data, folder / f"{name}.csv")
    for file in folder.glob("*.csv"):
        if file.stem not in taken:
            file.unlink()
