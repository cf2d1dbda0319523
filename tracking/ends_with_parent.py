"""Run a command that ends with the process that started this, also if that is killed.

    subprocess.Popen([sys.executable, "-m", "tracking.ends_with_parent", *command],
                     stdin=subprocess.PIPE, start_new_session=True)

The kernel closes the pipe when the parent is gone. All processes of the session end, too: a death
signal of Linux would reach the first one alone, and MLflow's server is several.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def main() -> int:
    """Run the command of the arguments. Returns its exit code, as a shell has it."""
    process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    code = process.wait()
    return code if code >= 0 else 128 - code


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os.killpg(os.getpgrp(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
