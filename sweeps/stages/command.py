"""The stage that runs a command of the user, which detects objects."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from lidarplace.clouds.clouds import Clouds
from lidarplace.detections.read import read_detections
from lidarplace.files.atomic import temporary
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.layouts import write_layout
from sweeps.configuration.evaluator import EvaluatorCommand
from sweeps.stages.collect import CollectedClouds, clouds_and_objects
from sweeps.stages.ground_truth import GroundTruth
from sweeps.stages.measure import DetectedFrames
from sweeps.stages.stage import Need, Stage, of_type

_LAST, _TAIL = 5, 64_000
"""How many lines of a log say why a command failed, among how many bytes at its end."""
_UNPRINTABLE = re.compile(r"\x1b\[[\d;]*[A-Za-z]|[\x00-\x1f\x7f-\x9f]")
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
    """A command returned no detections; it is tried again when the sweep is."""


@dataclass(frozen=True)
class CommandStage(Stage[DetectedFrames]):
    """Run a command that detects objects in the test frames.

    `digests`: of the content of what it depends on. `rig`, `seed`: replace `{rig}` and `{seed}` in
    it; None: it does not name them. `log`: file of its output."""

    evaluator: EvaluatorCommand
    digests: tuple[str, ...]
    classes: tuple[str, ...]
    rig: str | None
    seed: int | None
    log: Path = field(compare=False)

    name = "command"
    order = 30

    def need(self, gpu_share: float = 1.0) -> Need:
        return Need(gpu_share=self.evaluator.gpus, cpus=self.evaluator.cpus)

    def run(self, *inputs: BoxLog | CollectedClouds | GroundTruth) -> DetectedFrames:
        """Detect by the clouds of all frames and the objects in the training frames.

        Raises CommandFailed: the command fails, takes too long, or writes nothing or something
        wrong."""
        clouds, objects = clouds_and_objects(inputs)
        frames = pd.concat([log.frames for log in of_type(BoxLog, inputs)])
        return self.detect(frames, objects[objects["class"].isin(self.classes)], clouds)

    def detect(self, frames: pd.DataFrame, objects: pd.DataFrame, clouds: Clouds) -> DetectedFrames:
        """Run the command on `frames` of a box log; objects in test frames only check it."""
        from training.sanity_checks.check import check_detections  # SciPy

        frames, cautions = frames[frames["frame"].isin(clouds.frames)], list[str]()
        test_frames = frames[frames["split"] == "test"]
        in_test = objects["frame"].isin(test_frames["frame"])
        layout = self.evaluator.format
        self.log.parent.mkdir(parents=True, exist_ok=True)
        folder = temporary(self.log).absolute()  # the next driver removes what a killed one leaves
        (written := folder / "detections").mkdir(parents=True)
        try:
            listed = write_layout(layout, folder / "clouds", frames, objects[~in_test], clouds)
            values = {"clouds": folder / "clouds", "detections": written, "python": sys.executable}
            problem = self._run(values | {"rig": self.rig, "seed": self.seed})
            if not problem:
                listed_tests = listed[listed["split"] == "test"].reset_index(drop=True)
                log = BoxLog(objects[:0], listed_tests)
                try:
                    detections = read_detections([written], log, self.classes, layout=layout)
                    compared = detections, objects[in_test], test_frames, self.log.stem
                    accepted = self.evaluator.accept, "evaluator.accept: [{}]"
                    cautions = check_detections(*compared, *accepted)
                    problem = "no detections" if detections.empty else ""
                except ValueError as error:
                    problem = str(error)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        if problem:
            raise CommandFailed(self._explain(problem, values))
        return DetectedFrames(detections, test_frames[["frame"]], cautions)

    def _explain(self, problem: str, values: dict[str, object]) -> str:
        """Return why the command failed, with the last lines of its output."""
        with self.log.open("rb") as log_file:
            log_file.seek(-min(_TAIL, log_file.seek(0, os.SEEK_END)), os.SEEK_END)
            text = log_file.read().decode("utf-8", "replace")
        for name in ("detections", "clouds"):  # folders that are gone
            problem, text = (t.replace(str(values[name]), f"{{{name}}}") for t in (problem, text))
        lines = [_UNPRINTABLE.sub("", line).strip() for line in text.splitlines()]
        last = " | ".join(list(filter(None, lines))[-_LAST:])[-1000:]
        return f"evaluator.command: {problem}; last lines: {last or 'none'}; log {self.log}"

    def _run(self, values: dict[str, object]) -> str:
        """Run the command to its end, and end all that it has started. Return what went wrong."""
        words = [
            re.sub(r"\{(\w+)\}", lambda name: str(values[name[1]]), word)
            for word in shlex.split(self.evaluator.command)
        ]
        threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), str(self.evaluator.cpus))
        read, write = os.pipe()
        with self.log.open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-ISc", _GUARD, str(read), *words],
                cwd=self.evaluator.folder,
                env=os.environ | threads,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=[read],
            )
        try:
            os.close(read)
            code = process.wait(self.evaluator.time_limit)
        except subprocess.TimeoutExpired:
            return f"killed after the time limit of {self.evaluator.time_limit:g} s"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            os.close(write)
        return f"exit code {code}" if code else ""
