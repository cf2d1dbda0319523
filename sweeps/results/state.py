"""State of a sweep, read from its store and its run folder; nothing is run."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from sweeps.configuration.grid import Sweep
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.plan.trial import Plan, Trial
from sweeps.results.promotion import at_most, promote
from sweeps.results.trial_results import trial_failure
from sweeps.stages.task import Task
from sweeps.store.local import Note, Store
from sweeps.store.lock import is_locked

Status = Literal["done", "running", "stopped", "waiting", "failed", "pruned"]


@dataclass(frozen=True)
class TrialState:
    """State of a trial: "stopped" is what ran when the driver was killed.

    The detail is what runs where, or why it failed or was pruned, the log the file with the
    traceback of a failure."""

    label: str
    status: Status
    detail: str = ""
    log: str = ""


@dataclass(frozen=True)
class SweepState:
    """State of a sweep, and whether a driver runs it now.

    Tasks by status, by stage, with `promote` at most these, and trials in the order of the grid."""

    name: str
    alive: bool
    stages: dict[str, dict[str, int]]
    trials: list[TrialState]


def sweep_state(sweep: Sweep, plan: Plan, store: Store) -> SweepState:
    """Read everything that a sweep has left so far."""
    folder = sweep.common.output / sweep.common.name
    alive = is_locked(folder)
    failed = FailureFolder(folder / "failed")
    finished = store.finished(plan.tasks)
    snapshot = _Snapshot(
        alive=alive,
        finished=finished,
        failures={key: why for key, why in failed.read().items() if key not in finished},
        notes=store.running_notes(task for task in plan.tasks if task.key not in finished),
    )

    def settled(tasks: list[Task]) -> bool:
        return all(task.key in finished or task.key in snapshot.failures for task in tasks)

    promotion = promote(sweep, plan, store, settled)
    if promotion.complete or not sweep.common.promote:
        open_ = [trial for trial in plan.trials if trial.key not in promotion.pruned]
        expected = plan.needed_for(task for trial in open_ for task in trial.results)
    else:
        expected = at_most(sweep, plan)
    stages: dict[str, Counter[str]] = {}
    for task in expected:
        stages.setdefault(task.stage.name, Counter())[snapshot.status(task)] += 1
    return SweepState(
        name=sweep.common.name,
        alive=snapshot.alive,
        stages={stage: dict(counts) for stage, counts in stages.items()},
        trials=[snapshot.trial(trial, plan, promotion.pruned, failed) for trial in plan.trials],
    )


@dataclass(frozen=True)
class _Snapshot:
    """Results, failures and running tasks at one moment, by key."""

    alive: bool
    finished: set[str]
    failures: Mapping[str, Failure]
    notes: Mapping[str, Note]

    def status(self, task: Task) -> Status:
        if task.key in self.finished:
            return "done"
        if task.key in self.failures:
            return "failed"
        return self._running if task.key in self.notes else "waiting"

    def trial(
        self, trial: Trial, plan: Plan, pruned: Mapping[str, str], failed: FailureFolder
    ) -> TrialState:
        if trial.key in pruned:
            return TrialState(trial.label, "pruned", pruned[trial.key])
        if all(task.key in self.finished for task in trial.results):
            return TrialState(trial.label, "done")
        failure = trial_failure(trial, self.failures)
        if failure is not None:
            task = next(task for task in trial.results if task.key in self.failures)
            return TrialState(trial.label, "failed", failure.reason, str(failed.log(task)))
        for task in plan.needed_for(trial.results):
            if task.key in self.notes and task.key not in self.finished:
                note = self.notes[task.key]
                where = f"{note.node}, process {note.pid}, since {note.since}"
                far = f", {note.progress}" if note.progress else ""
                return TrialState(trial.label, self._running, f"{task.stage.name} on {where}{far}")
        return TrialState(trial.label, "waiting")

    @property
    def _running(self) -> Status:
        return "running" if self.alive else "stopped"
