"""A part of a report."""

from __future__ import annotations

from dataclasses import dataclass, field

import plotly.graph_objects as go

from tracking.report.tables import Table


@dataclass
class Section:
    """A heading with sentences, figures in `columns` and tables below it."""

    title: str
    notes: list[str] = field(default_factory=list)
    figures: list[go.Figure] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    columns: int = 3
