"""Configurations to begin with: `lidarplace init [FOLDER] [--vehicle NAME]`."""

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import command
from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import checked_input, known, new_app, verb, wrong
from lidarplace.files.atomic import write_text
from lidarplace.files.regular import regular

app = new_app()

VEHICLES = ("car", "shuttle", "truck")


@verb(app, "", "mine", "mine --vehicle shuttle")
def init(
    folder: Annotated[Path, typer.Argument(help="folder to write to")] = Path("examples"),
    vehicle: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(VEHICLES),
            help="write a search for your vehicle alone, to begin with such a body",
            autocompletion=lambda: list(VEHICLES),
        ),
    ] = None,
) -> None:
    """Write example files: sweeps, searches, requirements, labels, the paper's experiment.

    The README and the help of other commands refer to these examples. Existing files are kept
    unless you confirm."""
    with checked_input():
        texts = examples() if vehicle is None else {f"my_{vehicle}.yaml": start_of(vehicle)}
        for name, text in texts.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not _replaced(path, text):
                continue
            write_text(path, text)
            say(path)
    if vehicle is None:
        say(f"Next: {command('run', str(folder / 'grid.yaml'), '--dry-run')}")
        return
    path = folder / f"my_{vehicle}.yaml"
    say(f"Next: edit it, then {command('cheapest', str(path))}")


def start_of(vehicle: str) -> str:
    """Return a search for a vehicle as text. Raises ValueError: there is none of that name."""
    name = known("vehicle", vehicle, {name: name for name in VEHICLES})
    return files("sweeps").joinpath(f"examples/vehicles/{name}.yaml").read_text(encoding="utf-8")


def examples() -> dict[str, str]:
    """Return the text of the examples by their path in the folder, without those of vehicles."""
    folder = Path(str(files("sweeps").joinpath("examples")))
    paths = sorted(path for path in folder.rglob("*.*") if path.suffix in (".yaml", ".csv"))
    paths = [path for path in paths if path.parent.name != "vehicles"]
    return {str(path.relative_to(folder)): path.read_text(encoding="utf-8") for path in paths}


def _replaced(path: Path, text: str) -> bool:
    """Return whether an existing file may be replaced by `text`; exits if nobody can be asked."""
    if regular(path).read_bytes() == text.encode():
        return False
    try:
        return typer.confirm(f"{path} exists. Overwrite it?")
    except typer.Abort:
        wrong(f"{path}: exists; move it, or name another folder")
