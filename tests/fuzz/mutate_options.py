"""Wrong command lines: values that no option expects, by its type."""

from collections.abc import Sequence
from random import Random
from typing import Any

from typer.main import get_command

from tests.fuzz.nasty import NUMBERS, TEXTS

PATHS = (
    *("", "/", "no/such/file", "x" * 300, "a\x00b", "\udcff", "/dev/null", "/dev/full"),
    *("/proc/1/mem", "[/x]", "log/boxes.parquet", "log", "sweep.yaml", "--", "s3://", "http://x y"),
    *("/dev/zero", "pipe", "loop", "nothing"),  # the last three are made for each case
)
WORDS = (*TEXTS[:14], "\x1b[31m", "no=where", "=", "a.b.c=1", "s3://x/y", "1,2", "\udcff")


def options_of(app: Any, verb: str | None) -> list[Any]:
    """Parameters of a command that take a value."""
    command = get_command(app)
    command = command.commands[verb] if verb else command
    return [p for p in command.params if not getattr(p, "is_flag", False) and p.name != "help"]


def value_for(random: Random) -> str:
    """A wrong value for any parameter."""
    if random.random() < 0.5:
        return str(random.choice(NUMBERS)).removesuffix(".0")
    return random.choice((*WORDS, *PATHS))


def wrong_line(app: Any, arguments: Sequence[str], random: Random) -> tuple[list[str], str]:
    """The command line with one wrong thing, and which parameter that is."""
    words = list(arguments)
    group = hasattr(get_command(app), "commands")
    parameters = options_of(app, words[0] if group else None)
    chosen = random.choice([*parameters, None])
    if chosen is None:
        extra = random.choice(("--nope", "more", "-x", "--set", "\x00"))
        return [*words, extra], extra
    count = chosen.nargs if chosen.nargs > 1 else 1
    if chosen.param_type_name == "argument":
        positions = [i for i, word in enumerate(words) if not word.startswith("-")][group:]
        arguments_only = [p for p in parameters if p.param_type_name == "argument"]
        at = arguments_only.index(chosen)
        value = value_for(random)
        if at < len(positions):
            words[positions[at]] = value
        else:
            words.append(value)
        return words, str(chosen.metavar or chosen.name)
    name = max(chosen.opts, key=len)
    while name in words:
        at = words.index(name)
        del words[at : at + 1 + count]
    values = [value_for(random) for _ in range(1)] + ["0"] * (count - 1)
    if random.random() < 0.1:
        values = values[:-1]  # none
    return [*words, name, *values], name
