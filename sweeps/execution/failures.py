"""Failures of tasks, which stay in the run folder for reports and are not retried."""

from __future__ import annotations

import json
import traceback
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.base.foreign_code import plugin_place
from lidarplace.configuration.record import read_record
from lidarplace.files.atomic import write_text
from lidarplace.files.secret_urls import hide_secrets
from sweeps.stages.task import Task
from sweeps.store.result_folder import DamagedResult
from training.nvidia import is_out_of_memory


@dataclass(frozen=True)
class Failure:
    """The reason why a task has no result, a line, and the traceback.

    `lasting`: data or settings are to blame, so a retry fails alike; else the machine is.
    `out_of_gpu_memory`: a smaller batch may help. `follows`: the task was not run, as one that it
    needs had failed; reason and log are of that. `damaged`: a result that it needs was damaged, and
    is removed."""

    reason: str
    log: str = ""
    lasting: bool = False
    out_of_gpu_memory: bool = False
    follows: bool = False
    damaged: bool = False

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Describe an exception while it is handled."""
        text = hide_secrets(" ".join(str(error).split()))
        name, place = type(error).__name__, plugin_place(error)
        damaged = isinstance(error, DamagedResult)
        return cls(
            text if isinstance(error, ValueError) and not place else f"{place}{name}: {text}",
            hide_secrets(traceback.format_exc()),
            lasting=isinstance(error, (ValueError, ArithmeticError)) and not damaged,
            damaged=damaged,
            out_of_gpu_memory=is_out_of_memory(error),
        )


@dataclass(frozen=True)
class FailureFolder:
    """The folder `failed/` of a run folder: a file for each failure, and its traceback as text."""

    folder: Path

    def write(self, task: Task, failure: Failure) -> None:
        """Keep the failure of a task."""
        self.folder.mkdir(parents=True, exist_ok=True)
        text = f"{task.stage.name} '{task.label}'\n{failure.reason}\n\n{failure.log}"
        write_text(self.log(task), text)
        write_text(self._record(task.key), json.dumps(asdict(failure)))

    def read(self) -> Mapping[str, Failure]:
        """Return the failures by key of the task. Raises InputError for a damaged file."""
        return {path.stem: _read(path) for path in sorted(self.folder.glob("*.json"))}

    def lasting(self, rerun: bool, finished: Collection[str]) -> dict[str, Failure]:
        """Return the failures that a retry would repeat, by key; none if `rerun`.

        All others are forgotten: they are retried, or their keys are in `finished`."""
        lasting = {}
        for key, failure in self.read().items():
            # A failure that followed comes again with the one that it follows.
            if failure.lasting and not failure.follows and not rerun and key not in finished:
                lasting[key] = failure
            else:
                self.forget(key)
        return lasting

    def forget(self, key: str) -> None:
        """Remove the failure of a task."""
        self._record(key).unlink(missing_ok=True)
        for path in self.folder.glob(f"*-{key}.log"):
            path.unlink()

    def log(self, task: Task) -> Path:
        """Return the file of the traceback."""
        return self.folder / f"{task.stage.name}-{task.key}.log"

    def _record(self, key: str) -> Path:
        return self.folder / f"{key}.json"


def _read(path: Path) -> Failure:
    try:
        return read_record(path, Failure, "record of a failure")
    except ValueError as error:
        raise InputError(str(error), fix="remove it to retry its task") from None
