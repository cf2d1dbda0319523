"""What docs/extending.md says to write, put into a copy of the tree."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.docs_blocks import ROOT


def copy_tree(folder: Path) -> Path:
    """The packages with their compiled kernels, and the test of layers."""
    for package in ("lidarplace", "training", "tracking", "sweeps"):
        ignored = shutil.ignore_patterns("*.tmp.*", "*.pyc.*")  # as another process writes them
        shutil.copytree(ROOT / package, folder / package, ignore=ignored)
    (folder / "tests").mkdir()
    shutil.copy(ROOT / "tests/test_layers.py", folder / "tests")
    return folder


def blocks_of(heading: str) -> list[str]:
    """The blocks of code below a heading of the page."""
    page = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    (own,) = [
        part for part in re.split(r"^## ", page, flags=re.M) if part.startswith(f"{heading}\n")
    ]
    return re.findall(r"^```\w+\n(.*?)^```", own, re.M | re.S)


def put(path: Path, before: str, text: str) -> None:
    """Write `text` in front of the one place that says `before`."""
    content = path.read_text(encoding="utf-8")
    assert content.count(before) == 1, f"{path.name}: {before}"
    path.write_text(content.replace(before, text + before), encoding="utf-8")


def python(tree: Path, *arguments: str, code: int = 0) -> str:
    """Run Python with the packages of the tree; what it prints, on stderr if it fails."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=tree,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join([str(tree), str(ROOT)]), "COLUMNS": "300"}
        | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stderr if code else done.stdout


def check_layers(tree: Path) -> None:
    """No rule of imports is broken, and none has to be written anew."""
    python(tree, "-m", "pytest", "-q", "tests/test_layers.py", "-k", "not heavy")
