"""What a page writes: rigs and configurations, beside the file of the rigs alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lidarplace.studio.page.panel import Panel
from lidarplace.studio.studio import Studio
from lidarplace.studio.sweep_files import RUNS


class Files:
    """Writes what the fields of a panel name; what is there already is asked for first.

    Args:
        scene: the traffic as a configuration of a sweep has it.
    """

    def __init__(self, studio: Studio, panel: Panel, scene: Mapping[str, Any]) -> None:
        self._studio, self._panel, self._scene = studio, panel, scene
        self._overwrite: Callable[[], str] | None = None

    def save(self) -> str:
        """Save the rigs, or ask; what to tell."""
        path = self.beside(self._panel.path.value)

        def write(overwrite: bool) -> str:
            return f"saved: {self._studio.save(path, overwrite)}"

        return self._asking(write)

    def sweep(self) -> str:
        """Write a sweep of the rigs, or ask; its command."""
        path = self.beside(self._panel.sweep_path.value)
        return self._asking(lambda over: self._studio.sweep(path, self._scene, over))

    @property
    def evaluated(self) -> tuple[Path, Path]:
        """The evaluation of the rigs: its configuration and its run folder."""
        name = f"evaluation-of-{self._studio.file.path.stem}"
        return self.beside(f"{name}.yaml"), RUNS / name

    def evaluation(self) -> tuple[Path, Path]:
        """Write the evaluation of the rigs as they are; what `evaluated` says."""
        path, run = self.evaluated
        self._studio.evaluation(path, self._scene)
        return path, run

    def confirm(self) -> str:
        """Overwrite what was asked for last; what to tell."""
        overwrite, self._overwrite = self._overwrite, None
        return "" if overwrite is None else overwrite()

    def beside(self, name: str) -> Path:
        """A file in the folder of the rigs. Raises ValueError for one that is not."""
        if not re.fullmatch(r"(?!\.)[^/\x00-\x1f]+\.ya?ml", name):
            raise ValueError(
                "file name: invalid; expected NAME.yaml without a folder, NUL or line break, found "
                f"{name!r}"
            )
        return self._studio.file.path.parent / name

    def _asking(self, write: Callable[[bool], str]) -> str:
        try:
            return write(False)
        except FileExistsError:
            self._overwrite = lambda: write(True)
            self._panel.overwrite.visible = True
            raise
