"""How this program was started, so that the commands that it prints can be typed as they are."""

import shlex
import sys

from lidarplace.files.secret_urls import hide_secrets


def called() -> str:
    """The command that this process was started with, for a shell, without secrets."""
    return command(*map(hide_secrets, sys.argv[1:]))


def command(*words: str) -> str:
    """A command of this project for a shell: a verb and its arguments."""
    return shlex.join(["lidarplace", *words])
