"""Part of a report: sentences, figures, and tables of text cells with raw numbers for a file."""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking import labels
from tracking.figures.kit.style import SOFT_BREAK

MOST_ROWS = 50  # placements and trials that a table shows; a page must stay small


@dataclass(frozen=True)
class Column:
    """Column of a table: its head, the text of a cell by row, and whether it holds words.

    `cell` takes a row by the names of the data's columns; columns without words hold numbers."""

    head: str
    cell: Callable[[Mapping[Any, Any]], str]
    words: bool = False


def words(head: str, key: str = "", show: Callable[[Any], str] = str) -> Column:
    """Show the value under `key`, or under the head, as words."""
    return Column(head, lambda row: show(row[key or head]), words=True)


def numbers(head: str, key: str, form: str | Callable[[float], str]) -> Column:
    """Show the number under `key`, by a format of `digits` or a function."""
    show = partial(labels.digits, form=form) if isinstance(form, str) else form
    return Column(head, lambda row: show(row[key]))


def coefficient(head: str, key: str) -> Column:
    """Show the coefficient under `key` with its interval, of `key` with `_low` and `_high`."""

    def cell(row: Mapping[Any, Any]) -> str:
        value, low, high = (row[f"{key}{suffix}"] for suffix in ("", "_low", "_high"))
        with_interval = f"{labels.signed(value)} {labels.interval(low, high)}"
        return labels.DASH if np.isnan(value) else with_interval

    return Column(head, cell)


def in_points(head: str, keys: tuple[str, str, str], form: str) -> Column:
    """Show points with their interval in brackets, by the keys of value, low and high.

    Where the format has a sign they are a difference, which may be not significant."""

    def cell(row: Mapping[Any, Any]) -> str:
        value, low, high = (row[key] for key in keys)
        if np.isnan(low):
            return labels.digits(value, form)
        verdict = labels.not_significant(low, high) if form.startswith("+") else ""
        return f"{labels.digits(value, form)} ({labels.span(low, high, form)}){verdict}"

    return Column(head, cell)


PERCENT = dict.fromkeys(("mean", "sd", "low", "high"), "%")  # units of what means over seeds have
METRIC = Column("metric", lambda row: labels.metric_label(row["metric"], row["iou"]), words=True)
SURROGATE = words("surrogate", show=labels.surrogate_name)


def of_group(axes: Sequence[str]) -> list[Column]:
    """Return the columns of class, detector with its setting of the axes, and metric."""
    return [words("class"), Column("detector", partial(labels.detector_label, axes), True), METRIC]


@dataclass(frozen=True)
class Table:
    """Text cells under a caption; many rows are shown in a box that scrolls.

    Attributes:
        caption: what the table shows.
        head: names of the columns.
        rows: cells of every row.
        best: (row, column) of cells to stress.
        words: columns of words, the others hold numbers.
        wide: its head is not broken into lines.
        name: of its CSV file, without the ending; see `slug`. Empty for a table without a file.
        data: what the CSV file holds: unrounded numbers, units in the heads."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    words: frozenset[int] = frozenset({0})
    wide: bool = False
    name: str = ""
    data: pd.DataFrame | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(
        cls,
        caption: str,
        rows: pd.DataFrame,
        columns: Sequence[Column],
        units: Mapping[str, str] | None = None,
        **further: Any,
    ) -> Table:
        """Make a row for every one of `rows`; `further` are attributes.

        The CSV file, if it has a `name`, holds `rows` or `data`, with `units`."""
        if "name" in further:
            further["data"] = with_units(further.get("data", rows), units or {})
        return cls(
            caption,
            tuple(column.head for column in columns),
            tuple(tuple(column.cell(row) for column in columns) for row in rows.to_dict("records")),
            words=frozenset(i for i, column in enumerate(columns) if column.words),
            **further,
        )

    def without_dashes(self) -> Table:
        """Drop columns that have a dash in every row; the CSV file keeps them."""
        whole = range(len(self.head))
        with_values = [
            i for i in whole if not self.rows or any(r[i] != labels.DASH for r in self.rows)
        ]
        place = {old: new for new, old in enumerate(with_values)}
        return replace(
            self,
            head=tuple(self.head[i] for i in with_values),
            rows=tuple(tuple(row[i] for i in with_values) for row in self.rows),
            best=frozenset((row, place[i]) for row, i in self.best if i in place),
            words=frozenset(place[i] for i in self.words if i in place),
        )

    def first(self, most: int) -> Table:
        """Keep the first `most` rows; the caption then says so, the CSV file has all."""
        if len(self.rows) <= most:
            return self
        more = f"the first {most} of {len(self.rows):,} rows, the CSV file has all"
        best = frozenset(cell for cell in self.best if cell[0] < most)
        caption = f"{self.caption} · {more}"
        return replace(self, caption=caption, rows=self.rows[:most], best=best)


def with_units(data: pd.DataFrame, units: Mapping[str, str]) -> pd.DataFrame:
    """Add units in brackets to the names of columns."""
    return data.rename(columns={name: f"{name} ({unit})" for name, unit in units.items()})


def slug(*words: str) -> str:
    """Convert words to a part of a file's name or an address: a-z, 0-9, dots and hyphens."""
    plain = unicodedata.normalize("NFKD", " ".join(words)).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9.]+", "-", plain.lower()).strip("-.")[:80]


@dataclass
class Section:
    """Heading with sentences, figures in `columns` and tables below it.

    A `folded` one shows its heading until it is opened, or printed. Those on the first screen are
    its "head", and the "picture" beside the answer, without a heading. `links` are words by
    address, below the sentences; `pictures` addresses of PNGs that Markdown has for figures."""

    title: str
    notes: list[str] = field(default_factory=list)
    figures: list[go.Figure] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    columns: int = 3
    folded: bool = False
    place: Literal["page", "head", "picture"] = "page"
    links: dict[str, str] = field(default_factory=dict)
    pictures: list[str] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        """Fragment of a link to the section."""
        return slug(self.title)


def figure_title(figure: go.Figure) -> str:
    """Return the title of a figure as plain text in one line."""
    lines = str(figure.layout.title.text or "").replace(SOFT_BREAK, " ").replace("<br>", " · ")
    return html.unescape(re.sub(r"<[^>]*>", "", lines))
