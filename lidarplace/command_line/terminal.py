"""Text in the terminal: names are printed as they are, and nothing in them is obeyed."""

import sys
from collections.abc import Collection, Iterable, Sequence
from typing import Any, TextIO

from rich.console import Console
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

_NO_WIDTH = 100_000
_MOST_WARNINGS = 3


def visible(text: str) -> str:
    """Return text with what cannot be printed escaped, control characters but lines and tabs."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else _written(c) for c in text)


def _written(character: str) -> str:
    number = ord(character)
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}"


def say(text: object, file: TextIO | None = None) -> None:
    """Print a text, on stdout by default."""
    print(visible(str(text)), file=file or sys.stdout)


class Terminal(Console):
    """A console for which `[x]` is no style, `:x:` no picture, 1.5 no colour."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        """Return a text with a style, as cells, titles and lines are made of."""
        return super().render_str(visible(text), **settings)

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        """Render; elsewhere than in a terminal, tables are columns of text alone."""
        if isinstance(renderable, Table) and not self.is_terminal:
            renderable.box, renderable.pad_edge, renderable.title_justify = None, False, "left"
        return super().render(renderable, options)


def output() -> Terminal:
    """Return the console for tables. A file has no width: a row and a message are one line each."""
    return Terminal() if sys.stdout.isatty() else Terminal(width=_NO_WIDTH)


def print_warnings(console: Console, warnings: Sequence[str], page: str) -> None:
    """Print the first warnings, a line each, and on which page the others are."""
    lines = [f"warning: {text}" for text in warnings[:_MOST_WARNINGS]]
    if more := len(warnings) - len(lines):
        lines.append(f"{more} more warning{'s' * (more > 1)} in {page}")
    for line in lines:
        console.print(line, style="yellow", soft_wrap=True)


def table(
    title: str | None,
    head: Sequence[str],
    rows: Iterable[Iterable[object]] = (),
    words: Collection[str] = (),
) -> Table:
    """Return a table with numbers to the right, but for the first column and those in `words`."""
    formatted = Table(title=title)
    for name in head:
        left = name == head[0] or name in words
        formatted.add_column(name, justify="left" if left else "right")
    for row in rows:
        formatted.add_row(*map(str, row))
    return formatted
