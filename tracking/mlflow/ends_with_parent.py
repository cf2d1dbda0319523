"""A command that ends with the process that started it, also if that is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence


def ending_with_parent(command: Sequence[str]) -> list[str]:
    """The words with which to start `command`, with `stdin=subprocess.PIPE`.

    The kernel closes the pipe when the parent is gone. All processes of the command end: a death
    signal of Linux would reach the first one alone, and MLflow's server is several.
    """
    program = f"import sys; from {__name__} import run; sys.exit(run(sys.argv[1:]))"
    return [sys.executable, "-c", program, *command]


def run(command: Sequence[str]) -> int:
    """Run `command` in this process's place. Returns its exit code, as a shell has it."""
    if os.getpgrp() != os.getpid():
        os.setpgid(0, 0)  # the group that is ended is of this process
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    code = process.wait()
    return code if code >= 0 else 128 - code


def _end_with_parent() -> None:
    while os.read(0, 1):  # not `sys.stdin`, whose lock would be held when this process ends
        pass
    os.killpg(os.getpgrp(), signal.SIGTERM)
