"""Results on disk, each in a folder named by the hash of what determines it."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.files import replacing
from sweeps.task import Task

Value = dict[str, Any]
"""A result: DataFrames, arrays, `state_dict`s of tensors and plain data, by name."""

_MAPPED_BYTES = 1_000_000  # smaller arrays are not worth an open file


@dataclass(frozen=True)
class Store:
    """A folder of results.

    A result is written under a temporary name and renamed, so what is there is whole.
    """

    folder: Path

    def path(self, task: Task) -> Path:
        """Folder of the task's result."""
        return self.folder / task.stage / task.key

    def unfinished(self, task: Task) -> Path:
        """Folder in which the task may keep what it has so far."""
        return self.folder / task.stage / f".{task.key}.unfinished"

    def has(self, task: Task) -> bool:
        """Whether the result is there."""
        return self.path(task).is_dir()

    def save(self, task: Task, value: Mapping[str, Any], seconds: float) -> None:
        """Write a result and the seconds that it took. A result that is there already stays."""
        target = self.path(task)
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{task.key}-", dir=target.parent))
        try:
            plain = {}
            for name, item in value.items():
                if isinstance(item, pd.DataFrame):
                    item.to_parquet(partial / f"{name}.parquet", index=False)
                elif isinstance(item, np.ndarray):
                    np.save(partial / f"{name}.npy", item, allow_pickle=False)
                elif name.endswith("state_dict"):
                    import torch  # heavy, and only trainings have weights

                    torch.save(item, partial / f"{name}.pt")
                else:
                    plain[name] = item
            (partial / "result.json").write_text(
                json.dumps({"label": task.label, "seconds": seconds, "value": plain})
            )
            try:
                partial.rename(target)
            except OSError:
                if not self.has(task):  # else another process was faster with the same result
                    raise
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def load(self, task: Task) -> Value:
        """Read a result. Large arrays are mapped from the disk, read-only."""
        folder = self.path(task)
        value: Value = dict(self._record(task)["value"])
        for path in sorted(folder.iterdir()):
            if path.suffix == ".parquet":
                value[path.stem] = pd.read_parquet(path)
            elif path.suffix == ".npy":
                large = path.stat().st_size > _MAPPED_BYTES
                value[path.stem] = np.load(
                    path, mmap_mode="r" if large else None, allow_pickle=False
                )
            elif path.suffix == ".pt":
                import torch

                value[path.stem] = torch.load(path, weights_only=True)
        return value

    def seconds(self, task: Task) -> float:
        """Seconds that the result took when it was computed."""
        return float(self._record(task)["seconds"])

    def _record(self, task: Task) -> dict[str, Any]:
        return json.loads((self.path(task) / "result.json").read_text())


def write_text(path: Path, text: str) -> None:
    """Write a file under a temporary name and rename it."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
