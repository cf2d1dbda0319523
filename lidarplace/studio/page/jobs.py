"""Jobs of a page besides drawing: files, better poses, and commands that run meanwhile."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError
from lidarplace.studio.best_pose import BestPose
from lidarplace.studio.page.editing import Editing
from lidarplace.studio.page.panel import Panel
from lidarplace.studio.page.tables import evaluation_tables, progress
from lidarplace.studio.studio import Studio
from lidarplace.studio.sweep_files import RUNS, found_by_sweep

LINES = 6
"""Number of lines that a command has printed last and that are kept."""
NICENESS = 10
"""Niceness of a command, which leaves the processor to the page and to other work."""

_Say = Callable[[str, bool], None]


class Command:
    """A process `python -m` with these arguments, which starts at once.

    `on_output` is called with it after each line, and at the end, by a thread of its own."""

    def __init__(self, arguments: Sequence[str], on_output: Callable[[Command], None]) -> None:
        self.cancelled = False
        self._on_output = on_output
        self._lines: deque[str] = deque(maxlen=LINES)
        self._process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C at the studio reaches it once, by `cancel`
        )
        os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)
        self._reader = threading.Thread(target=self._read, daemon=True, name="command")
        self._reader.start()

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines that it has printed last."""
        return tuple(self._lines)

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

    def cancel(self) -> None:
        """Ask it to end, from which it can go on later; `wait` returns when it has."""
        self.cancelled = True
        self._process.send_signal(signal.SIGTERM)

    def wait(self) -> int:
        """Wait for its end, and until all its lines were read; return its exit code."""
        code = self._process.wait()
        self._reader.join()
        return code

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip():
                self._lines.append(line.rstrip())
                self._on_output(self)
        self._process.wait()
        self._on_output(self)


class Files:
    """Writes the files that a panel names; before it overwrites one it asks."""

    def __init__(self, studio: Studio, panel: Panel, scene: Mapping[str, Any]) -> None:
        self._studio, self._panel, self.scene = studio, panel, scene
        self._overwrite: Callable[[], str] | None = None

    def save(self) -> str:
        """Save the rigs, or ask; return the message."""
        path = self.path_of(self._panel.path.value)
        return self._confirming(lambda over: f"saved: {self._studio.save(path, over)}")

    def sweep(self) -> str:
        """Write a sweep of the rigs, or ask; return its command."""
        path = self.path_of(self._panel.sweep_path.value)
        return self._confirming(lambda over: self._studio.sweep(path, self.scene, over))

    @property
    def evaluated(self) -> tuple[Path, Path]:
        """Configuration and run folder of the evaluation of the rigs."""
        name = f"evaluation-of-{self._studio.file.path.stem}"
        return self.path_of(f"{name}.yaml"), RUNS / name

    def confirm(self) -> str:
        """Overwrite what was asked for last; return the message."""
        overwrite, self._overwrite = self._overwrite, None
        return "" if overwrite is None else overwrite()

    def path_of(self, name: str) -> Path:
        """Return a file in the folder of the rigs. Raises ValueError for one elsewhere."""
        if not re.fullmatch(r"(?!\.)[^/\x00-\x1f]+\.ya?ml", name):
            expected = "NAME.yaml without a folder, NUL or line break"
            raise InputError(key="file name", expected=expected, found=repr(name))
        return self._studio.file.path.parent / name

    def _confirming(self, write: Callable[[bool], str]) -> str:
        try:
            return write(False)
        except FileExistsError:
            self._overwrite = lambda: write(True)
            self._panel.overwrite.visible = True
            raise


class Jobs:
    """Jobs of the panel, of which one command runs at a time.

    `say` shows a line, and whether it is good."""

    def __init__(
        self, studio: Studio, panel: Panel, editing: Editing, files: Files, say: _Say
    ) -> None:
        self._studio, self._panel, self._editing, self._files = studio, panel, editing, files
        self._say, self._starting = say, threading.Lock()
        self._command: Command | None = None

    def improve(self) -> None:
        """Move the chosen LiDAR to where the rig finds most."""
        number = self._editing.one()
        self._say(f"looking for a better pose of LiDAR {number + 1} …", True)
        self._say(_describe(self._studio.improve(number)), True)

    def add_best(self) -> None:
        """Mount one more LiDAR where the rig then finds most."""
        self._say("looking for the best pose of one more LiDAR …", True)
        best = self._studio.add_best(self._editing.model_to_add())
        self._editing.choose_last()
        self._say(_describe(best), True)

    def evaluate(self) -> None:
        """Let a generalist evaluate all rigs while the page goes on."""
        with self._starting:
            self._idle()
            path, run = self._files.evaluated
            self._studio.evaluation(path, self._files.scene)
            self._start("run", str(path))
        if self._ended():
            self._panel.found.content = evaluation_tables(found_by_sweep(run))
            self._say(f"evaluated: {run.absolute() / 'decision.html'}", True)

    def compare(self) -> None:
        """Count the objects that one of two evaluated rigs finds and the other one misses."""
        with self._starting:
            self._idle()
            one, other = (field.value for field in self._panel.compared)
            if one == other:
                raise ValueError("name two different rigs")
            _, run = self._files.evaluated
            if not run.is_dir():
                raise ValueError("evaluate the rigs first")
            out = run / "compared"
            self._start("failures", str(run), "--rigs", f"{one},{other}", "--out", str(out))
        if self._ended():
            self._say(f"compared: {out.absolute() / 'failures.html'}", True)

    def cancel(self) -> None:
        """End the command that runs; what it has finished is kept."""
        if self._command is not None and self._command.exit_code is None:
            self._command.cancel()

    def close(self) -> None:
        """Cancel, and wait for the end."""
        self.cancel()
        if self._command is not None:
            self._command.wait()

    def _idle(self) -> None:
        if self._command is not None and self._command.exit_code is None:
            raise ValueError("another job is running; wait, or cancel it")

    def _start(self, *words: str) -> None:
        self._command = Command(["sweeps.main", *words], self._show)
        self._show(self._command)

    def _show(self, command: Command) -> None:
        self._panel.cancel.visible = command.exit_code is None
        self._panel.progress.content = progress(command.lines)

    def _ended(self) -> bool:
        """Wait for the command; return whether it succeeded. Raises ValueError if it failed."""
        assert self._command is not None
        code = self._command.wait()
        if code and self._command.cancelled:
            self._say("cancelled; the next start resumes it", True)
        elif code:
            last = self._command.lines[-1:] or (f"exit code {code}",)
            raise ValueError(last[0])
        return code == 0


def _describe(pose: BestPose) -> str:
    if pose.after != pose.before:
        return f"expected recall {pose.before:.4f} → {pose.after:.4f}"
    condition = f" that keeps {', '.join(pose.broken)}" if pose.broken else ""
    return f"no better pose was found{condition}"
