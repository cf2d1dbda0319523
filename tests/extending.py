"""The package of docs/extending.md, installed beside ours."""

import os
import re
import subprocess
import sys
from pathlib import Path

from tests.docs_blocks import ROOT


def write_package(folder: Path) -> Path:
    """`mypkg` as the page has it: its files by the names above their blocks."""
    page = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    for name, text in re.findall(
        r"`([\w/]+\.(?:toml|py))`:\n\n```\w+\n(.*?)^```", page, re.M | re.S
    ):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (folder / "mypkg/__init__.py").touch()
    return folder


def install(package: Path, target: Path) -> Path:
    """Install a package into a folder of its own, as `pip install PACKAGE` does."""
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--target")
    command = [sys.executable, "-m", "pip", "install", *options, str(target), str(package)]
    subprocess.run(command, check=True, capture_output=True)
    return target


def python(folder: Path, *arguments: str, path: Path | None = None, code: int = 0) -> str:
    """Run Python there, `path` with packages; stdout and stderr."""
    places = [str(ROOT), *([str(path)] if path else [])]
    result = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(places), "COLUMNS": "300"}
        | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == code, result.stdout + result.stderr
    return result.stdout + result.stderr
