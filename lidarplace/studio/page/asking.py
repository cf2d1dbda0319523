"""What takes a page seconds or minutes: better poses, evaluations and comparisons of rigs."""

import threading
from collections.abc import Callable, Sequence

from lidarplace.studio.best_pose import BestPose
from lidarplace.studio.page.editing import Editing
from lidarplace.studio.page.files import Files
from lidarplace.studio.page.panel import Panel
from lidarplace.studio.page.tables import evaluation_tables, progress
from lidarplace.studio.studio import Studio
from lidarplace.studio.subprocess_command import Command
from lidarplace.studio.sweep_files import found_by_sweep


class Asking:
    """Answers on the panel. One command runs at a time.

    Args:
        say: tells the person a line, and whether it is good.
    """

    def __init__(
        self,
        studio: Studio,
        panel: Panel,
        editing: Editing,
        files: Files,
        say: Callable[[str, bool], None],
    ) -> None:
        self._studio, self._panel, self._editing, self._files = studio, panel, editing, files
        self._say = say
        self._command: Command | None = None
        self._starting = threading.Lock()

    def improve(self) -> None:
        """Move the chosen LiDAR to where the rig finds most."""
        number = self._editing.one()
        self._say(f"looking for a better pose of LiDAR {number} …", True)
        found = self._studio.improve(number)
        self._say(_told(found), True)

    def add_best(self) -> None:
        """Mount one more LiDAR where the rig then finds most."""
        self._say("looking for the best pose of one more LiDAR …", True)
        found = self._studio.add_best(self._editing.model_to_add())
        self._editing.choose_last()
        self._say(_told(found), True)

    def evaluate(self) -> None:
        """Let a generalist judge all rigs, beside the page."""
        with self._starting:
            self._idle()
            path, run = self._files.evaluation()
            self._start(["sweeps.main", "run", str(path)])
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
            rigs = ["--rigs", f"{one},{other}", "--out", str(out)]
            self._start(["sweeps.main", "failures", str(run), *rigs])
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
            raise ValueError("something runs already; wait, or cancel it")

    def _start(self, arguments: Sequence[str]) -> None:
        self._command = Command(arguments, self._show)
        self._show(self._command)

    def _show(self, command: Command) -> None:
        self._panel.cancel.visible = command.exit_code is None
        self._panel.progress.content = progress(command.lines)

    def _ended(self) -> bool:
        """Wait for the command; whether it has done its work. Says what it did not."""
        assert self._command is not None
        code = self._command.wait()
        if code and self._command.cancelled:
            self._say("cancelled; the next time it goes on from there", True)
        elif code:
            last = self._command.lines[-1:] or (f"exit code {code}",)
            raise ValueError(last[0])
        return code == 0


def _told(found: BestPose) -> str:
    if found.after == found.before and found.broken:
        return f"no better pose was found that keeps {', '.join(found.broken)}"
    if found.after == found.before:
        return "no better pose was found"
    return f"expected recall {found.before:.4f} → {found.after:.4f}"
