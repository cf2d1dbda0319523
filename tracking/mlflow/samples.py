"""How busy the machine was at which moment: kept in a file until MLflow has it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock


@dataclass(frozen=True)
class Sample:
    """Metrics of a moment, in milliseconds since 1970."""

    time: int
    values: Mapping[str, float]


class Samples:
    """Samples in the order of their times, also those that an earlier driver left.

    Nothing else knows of them, so they are written to a file of JSON lines. A line that a killed
    driver, or a full disk, left without its end is skipped.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = Lock()
        self._waiting: list[Sample] = []
        if path.exists():
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                with suppress(ValueError, TypeError):
                    self._waiting.append(Sample(**json.loads(line)))

    def add(self, sample: Sample) -> None:
        """Keep a sample. Raises OSError if it could not be written to the file."""
        line = json.dumps({"time": sample.time, "values": dict(sample.values)})
        with self._lock:
            self._waiting.append(sample)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(f"\n{line}")  # whatever the line before ends with

    def waiting(self) -> list[Sample]:
        """Those that MLflow may not have."""
        with self._lock:
            return list(self._waiting)

    def delivered(self, count: int) -> None:
        """Forget the first ones. The file goes with the last of them."""
        with self._lock:
            del self._waiting[:count]
            if not self._waiting:
                self._path.unlink(missing_ok=True)
