"""Validation of the simulator on a team's own recordings: `lidarplace validate LOG`."""

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
from lidarplace.validation.fit import FEWEST_TRACKS

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
    from lidarplace.validation.page import write_page
    from lidarplace.validation.validation import validate

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
        write_page(out / "validation.html", f"Validation of {log.name}", validation, decision)
    _print(validation, f"{log}: simulated against real points")
    say(f"{decision.answer}: {' '.join(decision.why)}")
    say(out / "validation.html")


def _print(validation: "Validation", title: str) -> None:
    from lidarplace.validation.page import with_world

    if validation.tracks < FEWEST_TRACKS:
        expected = f"expected at least {FEWEST_TRACKS}, found {validation.tracks}"
        say(f"warning: too few tracks; {expected}", sys.stderr)
    scores = validation.scores[validation.scores["by"] == "all"]
    forms = {"objects": ",.0f", "ratio": ".2f", "bias": "+.2f", "spread": ".2f"}
    forms |= {"within_2": ".0%", "rho": ".2f"}
    rows = (
        [row["model"], *(format(row[name], form) for name, form in forms.items())]
        for row in scores.to_dict("records")
    )
    head = ("", "objects", "ratio", "bias, log2", "spread, log2", "within ×2", "rho")
    output().print(table(title, head, rows))
    say(with_world(validation))
