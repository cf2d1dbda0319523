"""One offline HTML page of sections; what the report of a sweep and that of a search share."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from lidarplace.command_line.terminal import say
from lidarplace.files.atomic import replacing
from tracking.figures.kit.style import theme
from tracking.pages.files_beside import FOLDER
from tracking.pages.section import Section, figure_title

SECTIONS_ALONE = Path(__file__).with_name("page.html")
"""The template of a page with nothing above its sections."""
LARGEST_PAGE = 15_000_000  # bytes of a page: what a mail may carry


def write_page(target: Path, template: Path, sections: Sequence[Section], **values: Any) -> Path:
    """Render `template`, which extends `page.html`, with `values` into `target`; return it.

    Plotly's program is in the page, nothing is loaded from a network. The heaviest figures of a
    page beyond `LARGEST_PAGE` are left out; its `sections`, and a line on stderr, then say which.
    `template` is of jinja, or `SECTIONS_ALONE`; values that it shows are escaped.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    drawn = {id(figure): figure_json(figure) for section in sections for figure in section.figures}

    def render() -> bytes:
        page = environment.get_template(template.name).render(
            **values,
            sections=sections,
            folder=FOLDER,
            plotlyjs=get_plotlyjs(),
            themes=json.dumps({"light": theme(False), "dark": theme(True)}),
            as_json=lambda figure: drawn[id(figure)],
            figure_title=figure_title,
        )
        return page.encode()

    page = render()
    if len(page) > LARGEST_PAGE:
        _leave_out(sections, drawn, len(page) - LARGEST_PAGE, target)
        page = render()
    with replacing(target) as partial:
        partial.write_bytes(page)
    return target


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


def figure_json(figure: go.Figure) -> str:
    """A figure as JSON that no text in it can end the script element around it."""
    return str(figure.to_json()).replace("<", "\\u003c")
