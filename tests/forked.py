"""Commands of this project in processes that have imported everything when they start.

A command that trains, draws and logs computes for ten seconds to import what it needs, more than it
takes for a tiny sweep. Here it is a fork of a process that did so once. The test of a program's
start itself, and of what it imports, takes a fresh interpreter.
"""

import atexit
import gc
import multiprocessing
import os
import socket
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from multiprocessing import forkserver
from pathlib import Path
from unittest.mock import patch

from sweeps.main import main

ROOT = Path(__file__).parents[1]
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""As on Ray: with more, sums of a training come in another order. A fork has no threads of others,
so all commands have these."""
GUARD_S = 1800
"""No command takes so long, however busy the machine: one that does hangs."""
_OTHERS = [
    *("matplotlib.pyplot", "mlflow.store.tracking.sqlalchemy_store", "mlflow.tracking"),
    *("plotly.graph_objects", "scipy.stats", "torch._dynamo", "torchvision"),
]
"""Without Ray, which reads variables when it is imported."""
_OWN = [
    *(
        "sweeps.commands.run",
        "sweeps.results.run_folder",
        "sweeps.commands.search",
        "sweeps.plan.plan",
    ),
    *("tracking.report.build", "training", "tests.forked_start"),
]


@cache
def _context() -> multiprocessing.context.ForkServerContext:
    context = multiprocessing.get_context("forkserver")
    # What cannot be imported would be left out, and every command import it again.
    assert all(find_spec(name) for name in _OWN)
    context.set_forkserver_preload([*_OTHERS, *_OWN])
    with patch.dict(os.environ, ONE_THREAD | {"PYTHONPATH": str(ROOT)}):
        forkserver.ensure_running()
    return context


class Forked:
    """`lidarplace VERB ARGUMENT…` or `python -c CODE` in a folder, as far as tests need a
    `subprocess.Popen`.

    Args:
        command: the verb, then its arguments; or `-c` and the code.
        folder: in which it runs.
        out: file that gets what it prints.
        err: file that gets its errors, None for `out`.
        environment: variables, None for those of this process.
        site: folder of installed packages.
    """

    def __init__(
        self,
        command: list[str],
        folder: Path,
        out: Path,
        err: Path | None = None,
        environment: Mapping[str, str] | None = None,
        site: Path | None = None,
    ) -> None:
        variables = dict(os.environ if environment is None else environment)
        path = os.pathsep.join(map(str, filter(None, (ROOT, site))))
        variables |= ONE_THREAD | {"PYTHONPATH": path, "COLUMNS": "200"}
        arguments = (command, folder, (out, err or out), variables)
        self._process = _context().Process(target=_run, args=arguments)
        self._process.start()
        self.pid = self._process.pid
        self.kill = self._process.kill
        atexit.register(self.kill)  # a failed test leaves none

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        return self._process.exitcode


def run_forked(
    command: list[str],
    folder: Path,
    logs: Path,
    environment: Mapping[str, str] | None = None,
    site: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run it to its end; what it prints goes through files in `logs`."""
    out, err = logs / "out.log", logs / "err.log"
    for file in (out, err):
        file.unlink(missing_ok=True)
    code = Forked(command, folder, out, err, environment, site).wait(GUARD_S)
    return subprocess.CompletedProcess(command, code, out.read_text(), err.read_text())


def _run(
    command: list[str], folder: Path, files: tuple[Path, Path], environment: dict[str, str]
) -> None:
    gc.freeze()  # what was imported is no garbage: to look through it copies its pages
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = environment["PYTHONPATH"].split(os.pathsep)
    for number, file in enumerate(files, start=1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)  # both may be one
    sys.stdout, sys.stderr = (os.fdopen(number, "w", 1, closefd=False) for number in (1, 2))
    os.chdir(folder)
    if command[0] == "-c":
        sys.argv = ["-c", *command[2:]]
        exec(command[1], {"__name__": "__main__"})
    else:
        sys.argv[1:] = command[1:]
        main(command[0])


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])
