"""One HTML page with figures side by side; it needs no network."""

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from lidarplace.files.atomic import write_text
from lidarplace.viewing.scene import CAMERAS
from lidarplace.viewing.style import theme


def write_page(
    path: Path,
    title: str,
    notes: Sequence[str],
    figures: Sequence[go.Figure],
    cameras: Mapping[str, Any] = CAMERAS,
) -> None:
    """Write figures side by side as one page with a shared legend and camera; makes its folder.

    `notes` are paragraphs of plain text. `cameras` are those of scenes in space, by the name on a
    button; none for figures from above."""
    page = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(title),
        notes="\n".join(f"<p>{html.escape(note)}</p>" for note in notes),
        plots="\n".join(
            f'<div class="plot"><script type="application/json">{as_json(figure)}</script></div>'
            for figure in figures
        ),
        plotlyjs=get_plotlyjs(),
        themes=json.dumps({"light": theme(False), "dark": theme(True)}),
        cameras=json.dumps(cameras),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, page)


def as_json(figure: go.Figure) -> str:
    """Write a figure as JSON that no text in it can end the script element around it."""
    return str(figure.to_json()).replace("<", "\\u003c")
