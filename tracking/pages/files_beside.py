"""Files next to a page: the raw numbers of its tables, and what it says as Markdown."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from lidarplace.command_line.terminal import visible
from lidarplace.files.atomic import replacing
from lidarplace.files.csv import write_csv
from tracking.pages.section import Section, Table, figure_title

FOLDER = "tables"


def write_csv_files(folder: Path, sections: Sequence[Section]) -> None:
    """Write every table that has data to `folder`/NAME.csv, and remove other CSV files there.

    Two tables of one name get a number each, also in `sections`.
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


def write_markdown(
    target: Path,
    title: str,
    first: Sequence[str],
    sections: Sequence[Section],
    last: Mapping[str, str],
    page: str,
) -> Path:
    """Write sentences, tables and the names of figures to `target`; return it.

    `first` are blocks of Markdown below the title, `last` verbatim texts at the end by heading,
    `page` the file name of the HTML page, which has the figures.
    """
    blocks = [f"# {escaped(title)}", *first]
    for section in sections:
        blocks += [f"## {escaped(section.title)}", *map(escaped, section.notes)]
        blocks += [f"[{escaped(words)}]({address})" for address, words in section.links.items()]
        if section.figures:
            titles = (figure_title(figure) or section.title for figure in section.figures)
            names = "; ".join(map(escaped, titles))
            blocks.append(f"Figures in [{page}]({page}#{section.anchor}): {names}.")
        for table in section.tables:
            source = f" ([CSV]({FOLDER}/{table.name}.csv))" if table.data is not None else ""
            blocks += [f"**{escaped(table.caption)}**{source}", _table(table)]
    for heading, words in last.items():
        blocks += [f"## {escaped(heading)}", verbatim(words)]
    with replacing(target) as partial:
        partial.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")
    return target


def escaped(words: str) -> str:
    """Words in one line that Markdown shows as they are."""
    line = visible(" ".join(words.split()))
    # A list would begin with the last two.
    return re.sub(r"([\\`*_\[\]<>|#&~]|^[-+])", r"\\\1", line)


def _table(table: Table) -> str:
    rule = ("---" if i in table.words else "---:" for i in range(len(table.head)))
    rows = [
        [f"**{escaped(c)}**" if (i, j) in table.best else escaped(c) for j, c in enumerate(row)]
        for i, row in enumerate(table.rows)
    ]
    lines = [map(escaped, table.head), rule, *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def verbatim(words: str) -> str:
    """A block of code, fenced by more backticks than it holds in a row."""
    longest = max((len(run) for run in re.findall("`+", words)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}\n{words.rstrip()}\n{fence}"
