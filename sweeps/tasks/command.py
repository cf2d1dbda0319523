"""A command of the user's own that detects objects: what it is given, and what becomes of it."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import suppress

import pandas as pd

from lidarplace.clouds.clouds import Clouds
from lidarplace.detections.read import read_detections
from lidarplace.files.atomic import temporary
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.layouts import write_layout
from sweeps.tasks.parameters import CommandParams
from sweeps.tasks.results import Judged
from training.sanity_checks.check import check_detections

_LAST, _TAIL = 5, 64_000
"""Lines of a log that say why a command failed, among so many bytes."""
_UNSHOWN = re.compile(r"\x1b\[[\d;]*[A-Za-z]|[\x00-\x1f\x7f-\x9f]")
"""Colours and control characters."""

# Becomes the command, and leaves a process that ends its group with the worker, killed or not:
# the pipe closes. It is no child of the command, which may wait for all of its own.
_GUARD = """
import os, signal, sys
pipe, leader = int(sys.argv[1]), os.getpid()
if (child := os.fork()) == 0:
    if os.fork() == 0:
        os.setsid()
        os.read(pipe, 1)
        try:
            os.killpg(leader, signal.SIGKILL)
        finally:
            os._exit(0)
    os._exit(0)
os.waitpid(child, 0)
os.close(pipe)
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
try:
    os.execvp(sys.argv[2], sys.argv[2:])
except OSError as error:
    sys.exit(f"{sys.argv[2]}: {error.strerror}")
"""


class CommandFailed(RuntimeError):
    """Why a command has no detections; it is tried again when the sweep is."""


def detected_by(
    params: CommandParams, frames: pd.DataFrame, objects: pd.DataFrame, clouds: Clouds
) -> Judged:
    """Run a command that detects objects in the test frames among `frames` of a box log, by the
    clouds of all and the objects in the others; those in the test frames only check it. Raises
    CommandFailed: it fails, takes too long, or writes nothing or something wrong."""
    frames, cautions = frames[frames["frame"].isin(clouds.frames)], list[str]()
    testing = frames[frames["split"] == "test"]
    tested = objects["frame"].isin(testing["frame"])
    layout = params.evaluator.format
    params.log.parent.mkdir(parents=True, exist_ok=True)
    folder = temporary(params.log).absolute()  # the next driver removes what a killed one leaves
    (found := folder / "detections").mkdir(parents=True)
    try:
        told = write_layout(layout, folder / "clouds", frames, objects[~tested], clouds)
        values = {"clouds": folder / "clouds", "detections": found, "python": sys.executable}
        problem = _run(params, values | {"rig": params.rig, "seed": params.seed})
        if not problem:
            log = BoxLog(objects[:0], told[told["split"] == "test"].reset_index(drop=True))
            try:
                detections = read_detections([found], log, params.classes, layout=layout)
                compared = detections, objects[tested], testing, params.log.stem
                accepted = params.evaluator.accept, "evaluator.accept: [{}]"
                cautions = check_detections(*compared, *accepted)
                problem = "no detections" if detections.empty else ""
            except ValueError as error:
                problem = str(error)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if problem:
        with params.log.open("rb") as log_file:
            log_file.seek(-min(_TAIL, log_file.seek(0, os.SEEK_END)), os.SEEK_END)
            text = log_file.read().decode("utf-8", "replace")
        for name in ("detections", "clouds"):  # which are gone
            problem, text = (t.replace(str(values[name]), f"{{{name}}}") for t in (problem, text))
        lines = [_UNSHOWN.sub("", line).strip() for line in text.splitlines()]
        last = " | ".join(list(filter(None, lines))[-_LAST:])[-1000:]
        raise CommandFailed(
            f"evaluator.command: {problem}; last lines: {last or 'none'}; log {params.log}"
        )
    return Judged(detections, testing[["frame"]], cautions)


def _run(params: CommandParams, values: dict[str, object]) -> str:
    """Run the command to its end, and end all that it has started. Returns what went wrong."""
    words = [
        re.sub(r"\{(\w+)\}", lambda name: str(values[name[1]]), word)
        for word in shlex.split(params.evaluator.command)
    ]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), str(params.evaluator.cpus))
    read, write = os.pipe()
    with params.log.open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-ISc", _GUARD, str(read), *words],
            cwd=params.evaluator.folder,
            env=os.environ | threads,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=[read],
        )
    try:
        os.close(read)
        code = process.wait(params.evaluator.time_limit)
    except subprocess.TimeoutExpired:
        return f"killed after the time limit of {params.evaluator.time_limit:g} s"
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        os.close(write)
    return f"exit code {code}" if code else ""
