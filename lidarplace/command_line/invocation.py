"""How this program was started, so that the commands that it prints can be typed as they are."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from lidarplace.files.secret_urls import hide_secrets

_INSTALLED = "lidarplace"


def called() -> str:
    """The command that this process was started with, for a shell, without secrets."""
    spec = sys.modules["__main__"].__spec__
    if spec is not None:
        program = ["python", "-m", spec.name.removesuffix(".__main__")]
    else:  # installed
        program = [Path(sys.argv[0]).name]
    return shlex.join([*program, *map(hide_secrets, sys.argv[1:])])


def command(module: str, *arguments: str) -> str:
    """A command of this project for a shell: `lidarplace VERB …` within the installed program.

    Args:
        module: as in `python -m MODULE …`, which it is else; its last part names the verb.
    """
    installed = Path(sys.argv[0]).name == _INSTALLED
    verb = module.rpartition(".")[2].replace("_", "-")
    program = [_INSTALLED, verb] if installed else ["python", "-m", module]
    return shlex.join([*program, *arguments])
