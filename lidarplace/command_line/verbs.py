"""Parts of all commands: help with an example and exit codes, one line for a mistake."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Annotated, Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from lidarplace.base.errors import InputError
from lidarplace.base.optional import needs
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.base.ranges import Range
from lidarplace.command_line.signals import exit_code_of, stopped_by_signals
from lidarplace.command_line.terminal import say, visible
from lidarplace.files.secret_urls import hide_secrets

T = TypeVar("T")

_LONGEST_MESSAGE = 900
_UsageError: Any = typer.BadParameter.__mro__[1]
"""Base of click's errors of usage, which typer has in another module with every version."""


class Verb(TyperCommand):
    """A command that ends without a traceback: by Ctrl-C, SIGTERM, a missing package."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        for parameter in self.params:
            if parameter.param_type_name == "argument" and parameter.metavar is None:
                parameter.metavar = str(parameter.name).upper()
            if (display_type := getattr(parameter, "display_type", None)) is not None:
                vars(parameter)["display_type"] = partial(_type_of_items, display_type)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line."""
        try:
            return super().parse_args(ctx, args)
        except _UsageError as error:
            error.message = visible(error.message)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command; plug-ins are imported from the folder of its argument `config`, too.

        Ctrl-C is one line and exit code 130, SIGTERM the same and 143."""
        config = ctx.params.get("config")
        try:
            with (
                stopped_by_signals(),
                nullcontext() if config is None else plugin_folder(config.parent),
            ):
                result = super().invoke(ctx)
            sys.stdout.flush()  # here, where typer takes care of a reader that has gone
        except KeyboardInterrupt as stop:
            print("\nStopped.", file=sys.stderr)
            raise typer.Exit(exit_code_of(stop)) from None
        except ModuleNotFoundError as error:
            if (remedy := needs(error)) is None:
                raise
            wrong(f"{ctx.command_path}: {remedy}")
        return result

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the example as the command was called, on lines of their own."""
        formatter.write((self.epilog or "").replace("{command}", ctx.command_path))


def _type_of_items(display_type: Callable[[Any], str], ctx: Any) -> str:
    """Return the type of an option in its help: `<path>` for typer's `<list[Path]>`."""
    return re.sub(r"list\[(\w+)\]", lambda item: item[1].lower(), display_type(ctx))


def new_app(**settings: Any) -> typer.Typer:
    """Return an app in the style of all commands: plain text, no traceback in colours."""
    return typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, **settings
    )


def verb(
    app: typer.Typer, *examples: str, failed: str | None = None, name: str | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a function a command of `app`, by default of its name.

    The help shows `examples` of arguments, and what exit code 1 means if the command has it."""
    lines = ["", f"Example{'s' if len(examples) > 1 else ''}:"]
    lines += [f"  {{command}} {example}".rstrip() for example in examples]
    lines += ["", "Exit codes:", "  0    done"]
    lines += [f"  1    {failed}"] if failed else []
    lines += ["  2    invalid input: one line on stderr names it"]
    lines += ["  130  stopped by Ctrl-C; 143 by SIGTERM", ""]
    return app.command(name, cls=Verb, epilog="\n".join(lines))


JsonOption = Annotated[bool, typer.Option("--json", help="print JSON for a script")]


def within(allowed: Range) -> Callable[[typer.CallbackParam, Any], Any]:
    """Return a callback of an option that rejects numbers outside of a range in one line."""

    def check(param: typer.CallbackParam, value: Any) -> Any:
        for number in value if isinstance(value, list | tuple) else (value,):
            if number is not None:
                with checked_input():
                    allowed.check("", number, place=max(param.opts, key=len))
        return value

    return check


def known(option: str, name: str, choices: Mapping[str, T]) -> T:
    """Return the choice of that name. Raises ValueError that lists the names."""
    if name not in choices:
        allowed = f"one of {', '.join(choices)}"
        raise InputError(place=f"--{option}", expected=allowed, found=name)
    return choices[name]


@contextmanager
def checked_input() -> Iterator[None]:
    """Call `wrong` for errors that the user's input raises in the block."""
    try:
        yield
    except (ValueError, OSError) as error:
        wrong(error)


def wrong(message: object) -> NoReturn:
    """Print what the user has to mend, in one line, and leave with exit code 2."""
    if isinstance(message, OSError) and message.filename and message.strerror:
        # The second is where a file was to be moved; the first is of a hidden one then.
        message = f"{message.filename2 or message.filename}: {message.strerror}"
    line = visible(hide_secrets(" ".join(str(message).split())))
    if len(line) > _LONGEST_MESSAGE:  # of names and values that nobody wrote by hand
        line = f"{line[: _LONGEST_MESSAGE // 2]} … {line[-_LONGEST_MESSAGE // 2 :]}"
    say(line, sys.stderr)
    raise typer.Exit(2)


def print_json(value: object) -> None:
    """Print for a script, nothing else being on stdout. Raises ValueError for NaN."""
    print(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False))
