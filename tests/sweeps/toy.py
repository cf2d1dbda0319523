"""Parameters and results of tasks whose stages a test replaces, and one who listens to tasks."""

from dataclasses import dataclass, make_dataclass
from typing import Any

from sweeps.tasks.stages import FUNCTIONS


@dataclass(frozen=True)
class Toy:
    n: Any = None


def result(**fields):
    """A result of these fields, such as some of a stage's."""
    return make_dataclass("Made", fields)(**fields)


def keep_in(patch, stage, kind):
    """A store reads results of the stage as those of a class."""

    def function(params, *inputs) -> kind: ...

    patch.setitem(FUNCTIONS, stage, function)


class Loud:
    """A listener that takes no failure."""

    def started(self, task): ...
    def finished(self, task): ...
    def failed(self, task, failure):
        raise AssertionError(f"{task.label}: {failure.reason}\n{failure.log}")
