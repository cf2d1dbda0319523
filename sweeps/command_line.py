"""The commands of the program `lidarplace`; packages add theirs as entry points.

A verb's module is imported when the verb is called. Without lidarplace's packages, as
`lidarplace doctor` has to run where some of them are missing."""

import ast
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup


@dataclass(frozen=True)
class Verb:
    """The module with the app of a verb, its line of help and its extra.

    `line`: "" for the first line of the module's docstring. `extra`: to be installed in addition to
    the base, if any."""

    module: str
    line: str = ""
    extra: str = ""

    def help(self) -> str:
        """Return the line of help."""
        line = self.line
        if not line:
            try:
                if (spec := find_spec(self.module)) is None or spec.origin is None:
                    raise ModuleNotFoundError(f"no module {self.module}")
                text = ast.get_docstring(ast.parse(Path(spec.origin).read_bytes()))
                line = (text or "").partition("\n")[0]
            except (Exception, SystemExit) as error:  # a package of a plug-in can raise anything
                line = f"broken: {type(error).__name__}: {error}"
        return f"{line} [{self.extra}]" if self.extra else line


VERBS = {
    "init": Verb("sweeps.commands.init", "Write example configurations."),
    "run": Verb("sweeps.commands.run", "Run a sweep.", "sweeps"),
    "search": Verb("sweeps.commands.search", "Search for the best placement.", "sweeps"),
    "cheapest": Verb(
        "sweeps.commands.cheapest", "Choose the cheapest rig that meets all requirements.", "sweeps"
    ),
    "status": Verb("sweeps.commands.status", "Show the progress of a sweep or a search."),
    "clean": Verb("sweeps.commands.clean", "Show the size of a store, and remove unused results."),
    "doctor": Verb(
        "sweeps.commands.doctor", "Check that everything is installed that a sweep needs."
    ),
    "report": Verb("tracking.report.command", "Write the report of a sweep again."),
    "figures": Verb(
        "tracking.report.figures_command",
        "Write figures of a sweep as files for a paper.",
        "sweeps",
    ),
    "search-report": Verb("tracking.search_report.command", "Write the report of a search again."),
    "dashboard": Verb("tracking.dashboard", "Open MLflow with the runs of sweeps.", "sweeps"),
    "record": Verb("sweeps.commands.record", "Record the scenes of a sweep as box logs.", "sweeps"),
    "convert": Verb("lidarplace.commands.convert", "Convert a data set or a table to a box log."),
    "sensors": Verb("lidarplace.commands.sensors", "List the LiDAR models of the catalogue."),
    "describe": Verb(
        "lidarplace.commands.describe", "Print frames and objects per frame of box logs."
    ),
    "validate": Verb(
        "tracking.validation.command", "Compare the simulator with the real points of a log."
    ),
    "view": Verb("lidarplace.commands.view", "Write a page of one frame of a box log."),
    "studio": Verb("lidarplace.studio.command", "Place LiDARs by hand in the browser.", "studio"),
    "export": Verb("lidarplace.commands.export", "Export a box log to KITTI's layout or Foxglove."),
    "rig": Verb("lidarplace.commands.rig", "Convert rigs from and to other tools' formats."),
    "pretrain": Verb("sweeps.commands.pretrain", "Train one detector on all placements.", "sweeps"),
    "evaluate": Verb("sweeps.commands.evaluate", "Compute AP and recall of external detections."),
    "calibrate": Verb(
        "sweeps.commands.calibrate", "Fit detection curves to the detections of a sweep."
    ),
    "failures": Verb(
        "sweeps.commands.failures", "Compare two rigs: which objects each finds and misses."
    ),
    "requirements": Verb("sweeps.commands.requirements", "Check rigs against requirements."),
    "benchmark": Verb(
        "sweeps.commands.benchmark", "Compare a predictor with the results of trained detectors."
    ),
}
"""Verbs by name, in the order of help; those of packages follow."""

for _point in sorted(entry_points(group="lidarplace.commands")):
    VERBS.setdefault(_point.name, Verb(_point.module, extra=" ".join(_point.extras)))


class _Listed(TyperCommand):
    """A verb in the list of verbs."""

    def get_short_help_str(self, limit: int = 0) -> str:
        return VERBS[str(self.name)].help()


class _Verbs(TyperGroup):
    """A group that lists verbs by name alone, and loads the one that is called."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name in VERBS:
            self.add_command(_Listed(name))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        if name in VERBS:
            if (verb := VERBS[name]).line:
                app = import_module(verb.module).app
            else:
                app = _app_of_plugin(name, verb.module)
            command = typer.main.get_command(app)
        return name, command, rest


def _app_of_plugin(name: str, module: str) -> Any:
    from lidarplace.base.foreign_code import import_plugin

    try:
        app = import_plugin(f"{module}:app", f"{name} ({module})")
        if not isinstance(app, typer.Typer):
            raise ValueError(f"{name} ({module}): app is no Typer app, but {type(app).__name__}")
    except ValueError as error:
        print(f"{error}; repair or uninstall it", file=sys.stderr)
        raise typer.Exit(2) from None
    return app


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
    epilog="[extra]: the extra that a command needs: pip install 'lidarplace[sweeps]'; "
    "simulated traffic needs [sumo]."
)
def lidarplace(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and exit"
        ),
    ] = False,
) -> None:
    """Decide where the LiDARs go on a vehicle. Each command has a --help with examples."""
