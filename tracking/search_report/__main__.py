"""`python -m tracking.search_report RUN`: build the page again from the run folder alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line import wrong
from tracking.search_report.build import build_search_report


def main(
    run: Annotated[Path, typer.Argument(help="folder that a search has left, runs/NAME")],
) -> None:
    """Write search.html into the folder of a search and print its path."""
    try:
        print(build_search_report(run))
    except (ValueError, OSError) as error:
        wrong(error)


if __name__ == "__main__":
    typer.run(main)
