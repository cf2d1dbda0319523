"""A part of a report."""

import html
import re
from dataclasses import dataclass, field

import plotly.graph_objects as go

from tracking.figures.kit.style import SOFT_BREAK
from tracking.pages.tables import Table, slug


@dataclass
class Section:
    """A heading with sentences, figures in `columns` and tables below it.

    A `folded` one shows its heading until it is opened, or printed. `links` lead to other files, by
    address, and stand below the sentences.
    """

    title: str
    notes: list[str] = field(default_factory=list)
    figures: list[go.Figure] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    columns: int = 3
    folded: bool = False
    links: dict[str, str] = field(default_factory=dict)

    @property
    def anchor(self) -> str:
        """What a link to the section ends with."""
        return slug(self.title)


def figure_title(figure: go.Figure) -> str:
    """The title of a figure as plain text in one line."""
    lines = str(figure.layout.title.text or "").replace(SOFT_BREAK, " ").replace("<br>", " · ")
    return html.unescape(re.sub(r"<[^>]*>", "", lines))
