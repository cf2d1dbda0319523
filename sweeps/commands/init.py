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
    """Write example files: a sweep, a search, requirements, a studio, the paper's experiment.

    The help of other commands refers to these examples. Existing files are kept unless you confirm.
    """
    with checked_input():
        folder.mkdir(parents=True, exist_ok=True)
        for source in sorted(files("sweeps").joinpath("examples").iterdir(), key=str):
            text = source.read_text(encoding="utf-8")
            path = folder / source.name
            if path.exists() and not _replaced(path, text):
                continue
            write_text(path, text)
            say(path)
    say(f"Next: {command('run', str(folder / 'grid.yaml'), '--dry-run')}")


def _replaced(path: Path, text: str) -> bool:
    """Whether what is there makes room for `text`. Who cannot be asked keeps it."""
    if regular(path).read_bytes() == text.encode():
        return False
    try:
        return typer.confirm(f"{path} is there. Overwrite it?")
    except typer.Abort:
        wrong(f"{path}: is there; move it away, or name another folder")
