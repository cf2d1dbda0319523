"""Configurations to begin with: `lidarplace init [FOLDER]`."""

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import command
from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import checked_input, new_app, verb, wrong
from lidarplace.files.atomic import write_text
from lidarplace.files.regular import regular

app = new_app()


@verb(app, "", "mine")
def init(
    folder: Annotated[Path, typer.Argument(help="folder to write to")] = Path("examples"),
) -> None:
    """Write example files: sweeps, searches, requirements, labels, the paper's experiment.

    The README and the help of other commands refer to these examples. Existing files are kept
    unless you confirm."""
    with checked_input():
        for name, text in examples().items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not _replaced(path, text):
                continue
            write_text(path, text)
            say(path)
    say(f"Next: {command('run', str(folder / 'grid.yaml'), '--dry-run')}")


def examples() -> dict[str, str]:
    """Return the text of the examples by their path in the folder."""
    folder = Path(str(files("sweeps").joinpath("examples")))
    paths = sorted(path for path in folder.rglob("*.*") if path.suffix in (".yaml", ".csv"))
    return {str(path.relative_to(folder)): path.read_text(encoding="utf-8") for path in paths}


def _replaced(path: Path, text: str) -> bool:
    """Return whether an existing file may be replaced by `text`; exits if nobody can be asked."""
    if regular(path).read_bytes() == text.encode():
        return False
    try:
        return typer.confirm(f"{path} exists. Overwrite it?")
    except typer.Abort:
        wrong(f"{path}: exists; move it, or name another folder")
