"""The verbs of the program `lidarplace`.

A verb's module is imported when the verb is called. Without lidarplace's packages, as
`lidarplace doctor` has to run where some of them are missing.
"""

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup


@dataclass(frozen=True)
class Verb:
    """A verb of the program.

    Attributes:
        module: has its app.
        line: of help.
        extra: what has to be installed beside the base, by the name of an extra; "" for nothing.
    """

    module: str
    line: str
    extra: str = ""


VERBS = {
    "init": Verb("sweeps.commands.init", "Write configurations to begin with."),
    "run": Verb("sweeps.commands.run", "Run a sweep.", "sweeps"),
    "search": Verb("sweeps.commands.search", "Search for the best placement.", "sweeps"),
    "status": Verb("sweeps.commands.status", "Show where a sweep or a search stands."),
    "clean": Verb("sweeps.commands.clean", "Show the sizes of a store, and make room in it."),
    "doctor": Verb(
        "sweeps.commands.doctor", "Look whether everything is there that a sweep needs."
    ),
    "report": Verb("tracking.report.command", "Make the report of a sweep again."),
    "search-report": Verb("tracking.search_report.command", "Make the report of a search again."),
    "dashboard": Verb("tracking.dashboard", "Open MLflow on the runs of sweeps.", "sweeps"),
    "record": Verb("sweeps.commands.record", "Record the scenes of a sweep as box logs.", "sweeps"),
    "convert": Verb("lidarplace.commands.convert", "Write the box log of a data set or a table."),
    "carla": Verb(
        "lidarplace.plugins.carla.command", "Collect box logs and clouds from CARLA.", "carla"
    ),
    "sensors": Verb("lidarplace.commands.sensors", "List the LiDARs that are known by name."),
    "describe": Verb(
        "lidarplace.commands.describe", "Print frames and objects per frame of box logs."
    ),
    "validate": Verb(
        "lidarplace.commands.validate", "Compare the simulator with the real points of a log."
    ),
    "view": Verb("lidarplace.commands.view", "Make a page of one frame of a box log."),
    "studio": Verb(
        "lidarplace.studio.command", "Place LiDARs by hand on a page of the browser.", "studio"
    ),
    "export": Verb("lidarplace.commands.export", "Write a box log as KITTI does, or for Foxglove."),
    "rig": Verb("lidarplace.commands.rig", "Read and write the rigs of other tools."),
    "pretrain": Verb(
        "sweeps.commands.pretrain", "Train a detector on all placements together.", "sweeps"
    ),
    "evaluate": Verb(
        "sweeps.commands.evaluate", "Print AP and recall of detections from elsewhere."
    ),
    "calibrate": Verb(
        "sweeps.commands.calibrate", "Fit detection curves to the detections of a sweep."
    ),
    "failures": Verb("sweeps.commands.failures", "What does one rig find and another one miss?"),
    "requirements": Verb("sweeps.commands.requirements", "Does a rig see what its vehicle needs?"),
    "accuracy": Verb("sweeps.commands.accuracy", "Compare ways to compute the surrogates."),
    "benchmark": Verb(
        "sweeps.commands.benchmark", "How well does a predictor tell what detectors reach?"
    ),
}
"""By name, in the order of help."""


class _Verbs(TyperGroup):
    """Lists verbs by name alone, and loads the one that is called."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name, verb in VERBS.items():
            needed = f" [{verb.extra}]" if verb.extra else ""
            self.add_command(TyperCommand(name, short_help=verb.line + needed))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        if name in VERBS:
            command = typer.main.get_command(import_module(VERBS[name].module).app)
        return name, command, rest


app = typer.Typer(
    cls=_Verbs,
    name="lidarplace",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    no_args_is_help=True,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"lidarplace {version('lidarplace')}")
        raise typer.Exit


@app.callback(
    epilog="[extra]: what a verb needs beside the base, as pip install 'lidarplace[sweeps]'; "
    "simulated traffic needs [sumo]."
)
def lidarplace(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and stop"
        ),
    ] = False,
) -> None:
    """Where do the LiDARs go on a vehicle? Each verb has a --help with examples."""
