"""One offline HTML page of sections; what the report of a sweep and that of a search share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from lidarplace.files import replacing
from tracking.figures.style import theme


def write_page(target: Path, template: Path, **values: Any) -> Path:
    """Render `template`, which extends `page.html`, with `values` into `target`; return it.

    Plotly's program is in the page, nothing is loaded from a network. The file appears in one step,
    so that a reader never meets half a page.

    Args:
        target: the file.
        template: of jinja; values that it shows are escaped.
        values: what the template names; `sections` is a list of `Section`.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template.name).render(
        **values,
        plotlyjs=get_plotlyjs(),
        themes=json.dumps({"light": theme(False), "dark": theme(True)}),
        as_json=_as_json,
    )
    with replacing(target) as partial:
        partial.write_text(page, encoding="utf-8")
    return target


def _as_json(figure: go.Figure) -> str:
    """A figure as JSON that no text in it can end the script element around it."""
    return str(figure.to_json()).replace("<", "\\u003c")
