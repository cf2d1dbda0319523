"""The state of a plan in the making: tasks, cautions, and what was computed before."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ParamSpec, TypeVar, cast

from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.plan.labels import task_label
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task

P = ParamSpec("P")
S = TypeVar("S", bound=Stage)
T = TypeVar("T")


class Once:
    """Calls a function once for the same arguments, all of them hashable."""

    def __init__(self) -> None:
        self._results: dict[Any, Any] = {}

    def __call__(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        call = (function, args, *sorted(kwargs.items()))
        if call not in self._results:
            self._results[call] = function(*args, **kwargs)
        result: T = self._results[call]
        return result


@dataclass(frozen=True, eq=False)
class Planning:
    """A plan in the making: points that agree in what a stage uses share its task.

    `tasks`: by key, each after its inputs. `cautions`: sentences, each once. `once`: for files and
    computations that points share."""

    sweep: Sweep
    tasks: dict[str, Task] = field(default_factory=dict)
    cautions: dict[str, None] = field(default_factory=dict)
    once: Once = field(default_factory=Once)

    def add(self, stage: S, label: str, inputs: Iterable[Task] = ()) -> Task[S]:
        """Add a task, unless there is one with the same result, and return it."""
        task = Task(stage, label, tuple(inputs))
        return cast(Task[S], self.tasks.setdefault(task.key, task))

    def add_for(
        self, grid_point: GridPoint, stage: S, inputs: Iterable[Task] = (), *names: str
    ) -> Task[S]:
        """Add a task that is labelled with the axes that decide it, and `names`."""
        inputs = tuple(inputs)
        keys = stage.config_keys().union(*(task.keys for task in inputs))
        return self.add(stage, task_label(grid_point, keys, *names), inputs)

    def caution(self, *sentences: str) -> None:
        """Note what the user is to know."""
        self.cautions.update(dict.fromkeys(sentences))

    @cached_property
    def placements(self) -> list[str]:
        """Names of the placements, in the order of the grid."""
        return list(dict.fromkeys(point.point.placement for point in self.sweep.points))
