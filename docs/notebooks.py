"""Runs a notebook in the current folder and writes it with its outputs as Markdown, for the site.

`python docs/notebooks.py NOTEBOOK PAGE SCRIPT`; SCRIPT is the address of plotly.js from the page.
"""

from __future__ import annotations

import ast
import json
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import plotly.graph_objects as go


def page(notebook: Path, script: str) -> str:
    """Text, code and outputs of all cells."""
    parts, scope = [f'<script src="{script}"></script>'], dict[str, Any]()
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] != "code":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        body = ast.parse(source).body
        last = [body.pop().value] if isinstance(body[-1], ast.Expr) else []
        name = f"{notebook.name}, cell {number}"
        with redirect_stdout(StringIO()) as printed:
            exec(compile(ast.Module(body, []), name, "exec"), scope)
            values = [eval(compile(ast.Expression(each), name, "eval"), scope) for each in last]
        if printed.getvalue():
            parts.append(f"```text\n{printed.getvalue()}```")
        parts += [_shown(value) for value in values if value is not None]
    return "\n\n".join(parts)


def _shown(value: Any) -> str:
    if isinstance(value, go.Figure):
        return value.to_html(full_html=False, include_plotlyjs=False)
    if isinstance(value, pd.Series):
        value = value.to_frame()
    if isinstance(value, pd.DataFrame):
        return value.to_html(border=0).replace(' class="dataframe"', "")
    return f"```text\n{value!r}\n```"


if __name__ == "__main__":
    notebook, out, script = sys.argv[1:]
    Path(out).write_text(page(Path(notebook), script), encoding="utf-8")
