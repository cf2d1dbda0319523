"""Command `lidarplace report RUN`."""

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb

app = new_app()


@verb(app, "runs/grid")
def report(
    run: Annotated[Path, typer.Argument(help="folder of a sweep, runs/NAME")],
    as_json: JsonOption = False,
) -> None:
    """Write the report of a sweep again from its folder, and print its path."""
    from tracking.report.build import build_report

    with checked_input():
        page = build_report(run)
    if as_json:
        print_json({"report": str(page)})
    else:
        say(page)
