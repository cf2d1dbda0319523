"""Command `lidarplace search-report RUN`."""

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb

app = new_app()


@verb(app, "runs/search")
def search_report(
    run: Annotated[Path, typer.Argument(help="folder of a search, runs/NAME")],
    as_json: JsonOption = False,
) -> None:
    """Write search.html again from the folder of a search, and print its path."""
    from tracking.search_report.build import build_search_report

    with checked_input():
        page = build_search_report(run)
    if as_json:
        print_json({"report": str(page)})
    else:
        say(page)
