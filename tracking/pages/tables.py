"""A table of a report: cells of text to be read, and the raw numbers for a file."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field, replace

import pandas as pd

MOST_ROWS = 50
"""Placements and trials that a table shows; a page must stay small."""


@dataclass(frozen=True)
class Table:
    """Text cells under a caption; many rows are shown in a box that scrolls.

    Attributes:
        caption: one line above the table.
        head: names of the columns.
        rows: cells, as many in each row as in `head`.
        best: (row, column) of cells to stress.
        words: columns of words, the others hold numbers.
        wide: its head is not broken into lines.
        name: of its CSV file, without the ending; see `slug`. Empty for a table without a file.
        data: what the CSV file holds: unrounded numbers, units in the heads.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    words: frozenset[int] = frozenset({0})
    wide: bool = False
    name: str = ""
    data: pd.DataFrame | None = field(default=None, compare=False, repr=False)

    def first(self, most: int) -> Table:
        """The first `most` rows; the caption then says so. The CSV file has all of them."""
        if len(self.rows) <= most:
            return self
        caption = (
            f"{self.caption} · the first {most} of {len(self.rows):,} rows, the CSV file has all"
        )
        best = frozenset(cell for cell in self.best if cell[0] < most)
        return replace(self, caption=caption, rows=self.rows[:most], best=best)


def slug(*words: str) -> str:
    """Words as a part of a file's name or an address: a-z, 0-9, dots and hyphens."""
    plain = unicodedata.normalize("NFKD", " ".join(words)).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9.]+", "-", plain.lower()).strip("-.")[:80]
