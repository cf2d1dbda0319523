"""Validation of the simulator on a team's recordings: `lidarplace validate LOG`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.options import LogArgument, VehicleOption
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input, new_app, verb
from lidarplace.configuration.correction import read_correction, write_correction
from lidarplace.configuration.vehicle import read_vehicle
from lidarplace.files.atomic import replacing
from lidarplace.logs.box_log import read_box_log

if TYPE_CHECKING:
    from lidarplace.validation.validation import Validation

app = new_app()


@verb(app, "logs/av2 --out validation", "logs/new --correction av2_fleet --vehicle body.yaml")
def main(
    log: LogArgument,
    out: Annotated[
        Path, typer.Option(help="folder of validation.html, the tables and correction.yaml")
    ] = Path("validation"),
    correction: Annotated[
        str | None,
        typer.Option(metavar="FILE|NAME", help="evaluate this correction instead of fitting one"),
    ] = None,
    vehicle: VehicleOption = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OBJECT",
            help="leave out a label, such as a wrong one: object_id or its beginning; repeatable",
        ),
    ] = None,
) -> None:
    """Compare simulated points with the real ones of a log, and fit a correction.

    The log needs the real points of each box and the rig that recorded them: `convert` keeps both.
    A static world (`convert --world`) stops simulated rays. Writes validation.html, which first
    answers whether to trust the simulator for this vehicle; its tables as Parquet; and
    correction.yaml for `lidar: {correction: …}`."""
    from lidarplace.validation.decision import decide
    from lidarplace.validation.validation import validate
    from tracking.validation.page import warnings_of, write_validation

    with checked_input():
        file = None if correction is None else read_correction(correction)
        body = None if vehicle is None else read_vehicle(vehicle)
        validation = validate(read_box_log(log), log, file, vehicle=body, without=without or ())
        out.mkdir(parents=True, exist_ok=True)
        decision = decide(validation)
        for name in ("scores", "objects", "subsets", "agreement", "fits", "worst"):
            with replacing(out / f"{name}.parquet") as partial, partial.open("wb") as parquet:
                getattr(validation, name).to_parquet(parquet, index=False)
        if file is None:
            write_correction(out / "correction.yaml", validation.correction)
        title = f"Validation of {log.name}"
        page = write_validation(out / "validation.html", title, validation, decision)
    _print(validation, f"{log}: simulated against real points")
    for warning in warnings_of(validation):
        say(f"warning: {warning}", sys.stderr)
    say(f"{decision.answer}: {' '.join(decision.why)}")
    say(page)


def _print(validation: "Validation", title: str) -> None:
    from tracking.validation.page import SCORES, with_world

    scores = validation.scores[validation.scores["by"] == "all"].to_dict("records")
    rows = ([row["model"], *(column.cell(row) for column in SCORES)] for row in scores)
    output().print(table(title, ["", *(column.head for column in SCORES)], rows))
    say(with_world(validation))
