"""How long tasks will take that have not run yet, from how long others of their stage took."""

from collections import Counter
from collections.abc import Iterable

from sweeps.execution.running import Running
from sweeps.tasks.task import Task


class TimeLeft:
    """Learns from tasks that end. Machines go on as they did: as many tasks at once.

    Args:
        tasks: those to run.
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._left = Counter(task.stage for task in tasks)
        self._seconds: dict[str, list[float]] = {}

    def ended(self, stage: str, seconds: float | None) -> None:
        """Take note of a task; `seconds` it took, None if it never began."""
        self._left[stage] -= 1
        if seconds is not None:
            self._seconds.setdefault(stage, []).append(seconds)

    def seconds(self, running: Running, elapsed: float) -> float | None:
        """Seconds to the end; None while a stage is left of which no task has ended.

        Args:
            running: what runs now.
            elapsed: seconds since the first task began.
        """
        mean = {s: sum(own) / len(own) for s, own in dict(self._seconds).items()}
        left = {stage: count for stage, count in self._left.items() if count > 0}
        if not left.keys() <= mean.keys() or elapsed <= 0:
            return None
        now = [(stage, for_) for stage, for_ in running.seconds() if stage in mean]
        ran = sum(map(sum, dict(self._seconds).values())) + sum(for_ for _, for_ in now)
        at_once = max(1.0, ran / elapsed)
        work = sum(count * mean[stage] for stage, count in left.items())
        work -= sum(min(for_, mean[stage]) for stage, for_ in now)
        begun = Counter(stage for stage, _ in now)
        # No number of machines makes one task shorter.
        waiting = [mean[stage] for stage, count in left.items() if count > begun[stage]]
        return max(work / at_once, *waiting, *(mean[stage] - for_ for stage, for_ in now), 0.0)
