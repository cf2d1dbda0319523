"""Run a command that ends with the process that started this, also if that is killed.

    subprocess.Popen([sys.executable, "-m", "tracking.ends_with_parent", *command],
                     stdin=subprocess.PIPE)

The kernel closes the pipe when the parent is gone. All processes of the command end: a death signal
of Linux would reach the first one alone, and MLflow's server is several.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def main() -> int:
    """Run the command of the arguments. Returns its exit code, as a shell has it."""
    if os.getpgrp() != os.getpid():
        os.setpgid(0, 0)  # the group that is ended is of this process
    process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    code = process.wait()
    return code if code >= 0 else 128 - code


def _end_with_parent() -> None:
    while os.read(0, 1):  # not `sys.stdin`, whose lock would be held when this process ends
        pass
    os.killpg(os.getpgrp(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
