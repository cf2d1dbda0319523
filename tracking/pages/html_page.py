"""Offline HTML page of sections, and the files next to it: raw numbers, and Markdown."""

import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from plotly.offline import get_plotlyjs

from lidarplace.command_line.terminal import say, visible
from lidarplace.files.atomic import replacing
from lidarplace.files.tables import write_csv
from lidarplace.viewing.page import as_json
from tracking.figures.kit.style import theme
from tracking.pages.section import Section, Table, figure_title

FOLDER = "tables"
SECTIONS_ALONE = Path(__file__).with_name("page.html")
"""Template of a page with nothing above its sections."""
LARGEST_PAGE = 15_000_000  # bytes of a page: what a mail may carry


def write_page(target: Path, template: Path, sections: Sequence[Section], **values: Any) -> Path:
    """Render `template`, which extends `page.html`, with `values` into `target`; return it.

    Plotly's program is in the page, nothing is loaded from a network. The heaviest figures of a
    page beyond `LARGEST_PAGE` are left out; its `sections`, and a line on stderr, then say which.
    `template` is of jinja, or `SECTIONS_ALONE`; values that it shows are escaped."""
    drawn = {id(figure): as_json(figure) for section in sections for figure in section.figures}

    def render() -> bytes:
        page = (
            _templates(template.parent)
            .get_template(template.name)
            .render(
                **values,
                sections=sections,
                folder=FOLDER,
                plotlyjs=get_plotlyjs(),
                themes=json.dumps({"light": theme(False), "dark": theme(True)}),
                as_json=lambda figure: drawn[id(figure)],
                figure_title=figure_title,
            )
        )
        return page.encode()

    page = render()
    if len(page) > LARGEST_PAGE:
        _leave_out(sections, drawn, len(page) - LARGEST_PAGE, target)
        page = render()
    with replacing(target) as partial:
        partial.write_bytes(page)
    return target


@cache
def _templates(folder: Path) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _leave_out(
    sections: Sequence[Section], drawn: dict[int, str], excess: int, target: Path
) -> None:
    """Take the heaviest figures out of `sections`, at least `excess` bytes of them."""
    by_weight = [
        (len(drawn[id(figure)].encode()), section, figure)
        for section in sections
        for figure in section.figures
    ]
    gone, limit = [], f"{LARGEST_PAGE / 1e6:.0f} MB"
    for size, section, figure in sorted(by_weight, key=lambda entry: -entry[0]):
        if excess <= 0:
            break
        section.figures = [other for other in section.figures if other is not figure]
        title = f"{figure_title(figure)} ({size / 1e6:.1f} MB)"
        section.notes.append(f"Left out, so that the page stays below {limit}: {title}.")
        gone.append(title)
        # The note is in the page too.
        excess += len(section.notes[-1].encode()) + 100 - size
    say(f"{target}: left out to stay below {limit}: {'; '.join(gone)}", sys.stderr)


def write_csv_files(folder: Path, sections: Sequence[Section]) -> None:
    """Write every table that has data to `folder`/NAME.csv, and remove other CSV files there.

    Two tables of one name get a number each, also in `sections`."""
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
    """Write sentences, pictures, tables and the names of figures to `target`; return it.

    `first` are blocks of Markdown below the title, `last` verbatim texts at the end by heading,
    `page` the file name of the HTML page, which has the figures."""
    blocks = [f"# {escaped(title)}", *first]
    for section in sections:
        blocks += [f"## {escaped(section.title)}", *map(escaped, section.notes)]
        blocks += [f"[{escaped(words)}]({address})" for address, words in section.links.items()]
        blocks += [f"![{Path(picture).stem}]({picture})" for picture in section.pictures]
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
    """Escape words as one line that Markdown shows as they are."""
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
    """Make a block of code, fenced by more backticks than it holds in a row."""
    longest = max((len(run) for run in re.findall("`+", words)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}\n{words.rstrip()}\n{fence}"
