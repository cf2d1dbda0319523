"""Command `lidarplace figures RUN`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb

app = new_app()


class Format(StrEnum):
    """Kind of the files."""

    pdf = "pdf"
    svg = "svg"
    png = "png"


@verb(app, "runs/grid --format svg")
def figures(
    run: Annotated[Path, typer.Argument(help="folder of a sweep, runs/NAME")],
    kind: Annotated[Format, typer.Option("--format", help="of the files")] = Format.pdf,
    out: Annotated[Path | None, typer.Option(help="folder; RUN/figures by default")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the figures of a sweep as files for a paper, and print their paths."""
    from tracking.report.analysis import Analysis
    from tracking.report.paper_figures import write_figures
    from tracking.run_folders.sweep import RunFolder

    with checked_input():
        analysis = Analysis(RunFolder.read(run))
        paths = write_figures(analysis, out or run / "figures", str(kind))
    if as_json:
        print_json({"figures": [str(path) for path in paths]})
    else:
        say("\n".join(map(str, paths)) or f"{run}: no data for a figure")
