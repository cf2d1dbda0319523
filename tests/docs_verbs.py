"""Commands of this project by the module after `python -m`."""

from __future__ import annotations

import importlib
from typing import Any

import typer


def app_of(module: str) -> typer.Typer:
    """The app that `python -m MODULE` starts."""
    found = importlib.import_module(module)
    if hasattr(found, "__path__"):
        found = importlib.import_module(f"{module}.__main__")
    return found.app


def check_options(app: typer.Typer, arguments: list[str]) -> None:
    """Raises click's UsageError if there is no such subcommand or option, or one lacks a value."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and arguments and arguments[0] in command.commands:
        command, arguments = command.commands[arguments[0]], arguments[1:]
    command.make_parser(command.make_context("it", [], resilient_parsing=True)).parse_args(
        list(arguments)
    )
