"""The installed program: `lidarplace run grid.yaml` is `python -m sweeps.run grid.yaml`.

A verb's module is imported when the verb is called. Without lidarplace's packages, as
`lidarplace doctor` has to run where some of them are missing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

VERBS = {
    "run": ("sweeps.run", "Run a sweep."),
    "search": ("sweeps.search.__main__", "Search for the best placement."),
    "status": ("sweeps.status", "Show where a sweep or a search stands."),
    "clean": ("sweeps.clean", "Show the sizes of a store, and make room in it."),
    "doctor": ("sweeps.doctor", "Look whether everything is there that a sweep needs."),
    "report": ("tracking.report.__main__", "Make the report of a sweep again."),
    "search-report": ("tracking.search_report.__main__", "Make the report of a search again."),
    "dashboard": ("tracking.dashboard", "Open MLflow on the runs of sweeps."),
    "record": ("sweeps.record", "Record the scenes of a sweep as box logs."),
    "convert": ("lidarplace.convert", "Write the box log of a data set or a table."),
    "carla": ("lidarplace.scenes.carla.__main__", "Collect box logs and clouds from CARLA."),
    "describe": ("lidarplace.describe", "Print frames and objects per frame of box logs."),
    "view": ("lidarplace.view", "Make a page of one frame of a box log."),
    "export": ("lidarplace.export", "Write a box log in KITTI's object layout."),
    "pretrain": ("sweeps.pretrain", "Train a detector on all placements of a sweep together."),
    "accuracy": ("sweeps.accuracy", "Compare ways to compute the surrogates."),
}
"""Module and one line of help, by verb."""


class _Verbs(TyperGroup):
    """Lists verbs by name alone, and loads the one that is called."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name, (_, line) in VERBS.items():
            self.add_command(TyperCommand(name, help=line))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        if name in VERBS:
            command = typer.main.get_command(import_module(VERBS[name][0]).app)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:  # while a verb is loaded
            print("\nStopped.", file=sys.stderr)
            raise typer.Exit(130) from None


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


@app.callback()
def lidarplace(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and stop"
        ),
    ] = False,
) -> None:
    """Where do the LiDARs go on a vehicle? Each verb has a --help with examples."""
