"""Commands of this project by their verb."""

from importlib import import_module
from typing import Any

import typer

from sweeps.command_line import VERBS


def app_of(verb: str) -> typer.Typer:
    """The app of a verb."""
    return import_module(VERBS[verb].module).app


def check_options(app: typer.Typer, arguments: list[str]) -> None:
    """Raises click's UsageError if there is no such subcommand or option, or one lacks a value."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and arguments and arguments[0] in command.commands:
        command, arguments = command.commands[arguments[0]], arguments[1:]
    command.make_parser(command.make_context("it", [], resilient_parsing=True)).parse_args(
        list(arguments)
    )
