"""Makes the tables and pictures of docs/architecture.md anew: `python -m docs.architecture`.

Rooms and their order are those of the test of layers, what each is for is its docstring.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from pathlib import Path

from lidarplace.base.code_version import PACKAGES
from tests.test_layers import FLOORS, MODULES, floors_of

FOLDER = Path(__file__).parent
PAGE = FOLDER / "architecture.md"
ROOMS, FLOW = FOLDER / "rooms.svg", FOLDER / "data_flow.svg"

LINE, ROW = 7.2, 28
"""Width of a letter and height of a floor, pixels."""

HOUSE = ((("sweeps", 980),), (("tracking", 420), ("training", 550)), (("lidarplace", 980),))
"""Packages beside and above each other, and their widths."""

BOX = (158, 44)
NODES = {
    "scene": (90, 80, "scene", "traffic or a log"),
    "log": (310, 80, "box log", "boxes, frames"),
    "pog": (530, 80, "POG", "voxels, each class"),
    "surrogates": (750, 80, "surrogates", "a placement's score"),
    "placement": (530, 170, "placement", "mounts and LiDARs"),
    "truth": (310, 260, "ground truth", "objects that count"),
    "clouds": (530, 260, "point clouds", "training and test"),
    "weights": (750, 260, "detector", "its weights"),
    "metrics": (970, 260, "metrics", "AP, recall"),
    "run": (970, 170, "run folder", "Parquet, JSON, arrays"),
    "report": (1180, 120, "report", "one HTML page"),
    "mlflow": (1180, 220, "MLflow", "a run a trial"),
}
"""Middle, name and content of what is computed."""

ARROWS: tuple[tuple[tuple[tuple[int, int], ...], str], ...] = (
    (((169, 80), (231, 80)), "scene"),
    (((389, 80), (451, 80)), "pog"),
    (((609, 80), (671, 80)), "surrogates"),
    (((310, 58), (310, 30), (750, 30), (750, 58)), "recall · accuracy · sampling_error"),
    (((609, 160), (700, 102)), ""),
    (((609, 180), (891, 180)), "requirements"),
    (((530, 192), (530, 238)), "collect"),
    (((310, 102), (310, 238)), "ground_truth"),
    (((372, 102), (465, 238)), ""),
    (((609, 260), (671, 260)), "finetune"),
    (((829, 260), (891, 260)), "evaluate"),
    (((310, 282), (310, 330), (970, 330), (970, 282)), ""),
    (((750, 330), (750, 282)), "pretrain, pretrained, detect, command, measure: alike"),
    (((829, 88), (920, 148)), ""),
    (((970, 238), (970, 192)), ""),
    (((1049, 160), (1101, 130)), ""),
    (((1049, 180), (1101, 210)), ""),
)
"""Corners, and the stages that compute what the arrow leads to."""


def page() -> str:
    """The page with its tables as the tree is now."""
    text = PAGE.read_text(encoding="utf-8")
    for package in reversed(PACKAGES):
        marks = rf"(?s)(<!-- rooms of {package} -->\n\n).*?(\n\n<!-- -->)"
        table = rooms_table(package)
        text, count = re.subn(marks, lambda found, own=table: found[1] + own + found[2], text)
        assert count == 1, package
    return text


def rooms_table(package: str) -> str:
    """Every room of a package, top floor first: what imports is above what it imports."""
    rows = ["| | |", "|---|---|"]
    for floor in floors(package):
        for name in floor:
            module = f"{package}.{name}"
            rows.append(_row(module))
            if module in FLOORS:
                inner = [n for names in floors(module) for n in names]
                rows += [_row(f"{module}.{n}") for n in inner if is_folder(f"{module}.{n}")]
    return "\n".join(rows)


def _row(module: str) -> str:
    name = module.partition(".")[2].replace(".", "/") + ("/" if is_folder(module) else ".py")
    said = ast.get_docstring(ast.parse(MODULES[module].read_text(encoding="utf-8")))
    assert said, f"{MODULES[module]} does not say what it is for"
    first = " ".join(said.split("\n\n")[0].split())
    return "| `{}` | {} |".format(name, first.replace("|", "\\|"))


def floors(folder: str) -> list[list[str]]:
    """Names on each floor, top first."""
    found: dict[int, list[str]] = {}
    for name, number in sorted(floors_of(folder).items()):
        if not name.startswith("__"):
            found.setdefault(number, []).append(name)
    return [found[number] for number in sorted(found, reverse=True)]


def is_folder(module: str) -> bool:
    """Whether a module is a package."""
    return MODULES[module].name == "__init__.py"


def rooms_picture() -> str:
    """The packages as a house: each floor imports from those below it alone."""
    parts: list[str] = []
    y = 10
    for packages in HOUSE:
        height = 40 + ROW * max(len(floors(package)) for package, _ in packages)
        x = 10
        for package, width in packages:
            parts += _panel(package, x, y, width, height)
            x += width + 10
        y += height + 10
    return _svg(1000, y, parts)


def _panel(package: str, left: int, top: int, width: int, height: int) -> list[str]:
    parts = [_rect(left, top, width, height, "#f6f8fa"), _text(left + 12, top + 24, package, 17)]
    y = top + 40
    for floor in floors(package):
        x: float = left + 12
        for name in floor:
            if is_folder(f"{package}.{name}"):
                inner = [name, *_inner(f"{package}.{name}")]
                label = inner[0] if len(inner) == 1 else f"{inner[0]}: {' '.join(inner[1:])}"
                size = LINE * len(label) + 24
                parts.append(_rect(x, y, size, ROW - 5, "#dbeafe"))
                parts.append(_text(x + size / 2, y + 16, label, 13, anchor="middle"))
                x += size + 8
        files = " ".join(n for n in floor if not is_folder(f"{package}.{n}"))
        parts.append(_text(x + 2, y + 16, files, 12, "#57606a"))
        y += ROW
    return parts


def _inner(folder: str) -> list[str]:
    """Rooms within a room, top first."""
    if folder not in FLOORS:
        return []
    return [n for names in floors(folder) for n in names if is_folder(f"{folder}.{n}")]


def flow_picture() -> str:
    """What is computed from what; a name at an arrow is that of a stage."""
    width, height = BOX
    parts = []
    for corners, stage in ARROWS:
        path = " ".join(f"{x},{y}" for x, y in corners)
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="#57606a" stroke-width="1.5" '
            'marker-end="url(#head)"/>'
        )
        (x0, y0), (x1, y1) = max(pairwise(corners), key=_length)
        aside = x0 == x1
        x, y = (x0 + x1) / 2 + (6 if aside else 0), (y0 + y1) / 2 + (4 if aside else -6)
        parts.append(_text(x, y, stage, 11.5, "#9a3412", "start" if aside else "middle"))
    for x, y, name, content in NODES.values():
        fill = "#dcfce7" if name in ("scene", "placement") else "#dbeafe"
        parts.append(_rect(x - width / 2, y - height / 2, width, height, fill))
        parts.append(_text(x, y - 2, name, 15, anchor="middle"))
        parts.append(_text(x, y + 15, content, 11.5, "#57606a", "middle"))
    return _svg(1270, 350, parts)


def _length(line: tuple[tuple[int, int], tuple[int, int]]) -> float:
    (x0, y0), (x1, y1) = line
    return abs(x1 - x0) + abs(y1 - y0)


def _svg(width: int, height: int, parts: Sequence[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif">\n'
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0,0 8,4 0,8z" fill="#57606a"/></marker></defs>\n'
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>\n'
    )
    return head + "\n".join(filter(None, parts)) + "\n</svg>\n"


def _rect(x: float, y: float, width: float, height: float, fill: str) -> str:
    return (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="5" '
        f'fill="{fill}" stroke="#8c959f"/>'
    )


def _text(
    x: float, y: float, text: str, size: float, fill: str = "#1f2328", anchor: str = "start"
) -> str:
    if not text:
        return ""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" fill="{fill}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    ROOMS.write_text(rooms_picture(), encoding="utf-8")
    FLOW.write_text(flow_picture(), encoding="utf-8")
    print(PAGE, ROOMS, FLOW)
