"""The command: `lidarplace report RUN…`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong

app = new_app()


@verb(app, "runs/grid", "runs/paper runs/mine --out runs/compared")
def report(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="folders of sweeps, runs/NAME"),
    ],
    out: Annotated[
        Path | None, typer.Option(help="folder for the comparison of several sweeps")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make the report of a sweep again from its folder alone, and print its path.

    Of several sweeps it makes comparison.html in --out: what differs in their configurations, and
    the placements that they share side by side.
    """
    from tracking.report.build import build_report
    from tracking.report.comparison.build import build_comparison

    try:
        if len(runs) == 1 and out is not None:
            raise ValueError("--out: leave it out for one RUN, whose report lies in its own folder")
        if len(runs) > 1 and out is None:
            raise ValueError("--out: name the folder for the comparison of several sweeps")
        page = build_report(runs[0]) if out is None else build_comparison(runs, out)
    except (ValueError, OSError) as error:
        wrong(error)
    if as_json:
        print_json({"report": str(page)})
    else:
        say(page)
