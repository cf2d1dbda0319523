"""Parameters of tasks whose stages a test replaces, and one who listens to tasks."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Toy:
    n: Any = None


class Loud:
    """A listener that takes no failure."""

    def started(self, task): ...
    def finished(self, task): ...
    def failed(self, task, failure):
        raise AssertionError(f"{task.label}: {failure.reason}\n{failure.log}")
