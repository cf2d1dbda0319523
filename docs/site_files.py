"""Hooks of MkDocs: files outside of docs/ that pages link to, notebooks, and the pages of the demo.

Notebooks run when the site is built, and are shown with their outputs.

A page of docs/ is at the root of the site, any other file of the project in `source/`. Links are
the same in both, so GitHub shows the pages, too.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from tempfile import TemporaryDirectory
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from plotly.offline import get_plotlyjs

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")
FENCE = re.compile(r"(^```.*?^```)", re.M | re.S)
DEMO = ("decision.html", "failures.html", "report.html")
PLOTLY = "plotly.min.js"


def on_files(files: Files, config: Any) -> Files:
    """Add what pages of docs/ link to, and what these files link to."""
    folder = Path(config["extra"]["demo"])
    files.append(File.generated(config, PLOTLY, content=get_plotlyjs()))
    for name in DEMO:
        if not (folder / name).is_file():
            raise PluginError(f"{folder / name}: no such file; run `make demo`")
        path = str((folder / name).resolve())
        files.append(File.generated(config, f"demo/{name}", abs_src_path=path))
    pending = [file for file in files if file.src_uri.endswith(".md")]
    known = {file.src_uri for file in files}
    while pending:
        page = pending.pop()
        for path in _linked(page):
            uri = uri_of(path)
            if uri in known or not (ROOT / path).is_file():
                continue
            if path.endswith(".ipynb"):
                content = _of_notebook(path, folder.resolve())
                file = File.generated(config, uri, content=content)
            else:
                file = File.generated(config, uri, abs_src_path=str(ROOT / path))
            files.append(file)
            known.add(uri)
            if uri.endswith(".md"):
                pending.append(file)
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to where the files are on the site; a folder has no page, so its link is text."""
    parts = FENCE.split(markdown)
    return "".join(
        part if part.startswith("```") else _LINKED_TEXT.sub(_moved(page.file), part)
        for part in parts
    )


_LINKED_TEXT = re.compile(r"(?<!!)\[((?:[^][]|\[[^]]*\])*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def _moved(file: File) -> Any:
    def replace(found: re.Match[str]) -> str:
        text, target, anchor = found[1], found[2], found[3] or ""
        if "://" in target:
            return found[0]
        path = _path(file, target)
        if (ROOT / path).is_dir():
            return text
        return f"[{text}]({relpath(uri_of(path), PurePosixPath(file.src_uri).parent)}{anchor})"

    return replace


def _linked(file: File) -> list[str]:
    text = FENCE.sub("", file.content_string)
    return [_path(file, found[1]) for found in LINK.finditer(text) if "://" not in found[1]]


def _path(file: File, target: str) -> str:
    """Where a link of a page leads to, from the root of the project."""
    uri = PurePosixPath(file.src_uri)
    at = uri.relative_to("source") if uri.parts[0] == "source" else PurePosixPath("docs") / uri
    return normpath(str(at.parent / target))


def uri_of(path: str) -> str:
    """The place on the site of a file of the project."""
    uri = path.removeprefix("docs/") if path.startswith("docs/") else f"source/{path}"
    return re.sub(r"\.ipynb$", ".md", uri)


@cache
def _of_notebook(path: str, demo: Path) -> str:
    """Its cells and their outputs; `runs/grid` is the run folder of the demo."""
    script = relpath(PLOTLY, PurePosixPath(uri_of(path)).parent)
    with TemporaryDirectory() as folder:
        (Path(folder) / "runs").mkdir()
        (Path(folder) / "runs/grid").symlink_to(demo)
        done = subprocess.run(
            [sys.executable, "-P", ROOT / "docs/notebooks.py", ROOT / path, "page.md", script],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise PluginError(f"{path}: {done.stderr}")
        return (Path(folder) / "page.md").read_text(encoding="utf-8")
