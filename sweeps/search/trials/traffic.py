"""The training traffic of a search, and rigs that a pool of workers assesses on it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import optuna
from optuna.trial import TrialState
from rich.console import Console

from lidarplace import ExpectedRecall
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES
from sweeps.execution.backends import Backend, Job
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.plan.surrogates import RECALL_FRAMES
from sweeps.search.problem.assess import Assessment, Criteria, Traffic, assess
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig
from sweeps.search.trials.study import Timing, assessment_of, finished_trials, tell
from sweeps.stages.pog import grids_of
from sweeps.stages.recall import RecallStage
from sweeps.stages.scene import SceneStage
from sweeps.stages.task import Task, tasks_of
from sweeps.store.local import Store
from sweeps.store.open import reference


class NoTraffic(RuntimeError):
    """A task that leads to the traffic failed, or the traffic is empty."""


def training_traffic(
    console: Console,
    problem: SearchProblem,
    store: Store,
    backend: Backend,
    scene: Mapping[str, Any] | None = None,
) -> Traffic:
    """Compute the traffic that the objectives need.

    `scene`: key path -> value, changes of the configuration. Raises ConfigError: a value is not
    allowed at its key path; NoTraffic: something failed, or `expected_recall` is an objective of a
    class of which no object counts."""
    if not any(objective.of_traffic for objective in problem.criteria.objectives):
        return Traffic({})
    sweep = problem.sweep(scene)
    tasks, trial = problem.pog_tasks(sweep)
    purpose = "search" if scene is None else f"search-{trial.pog.key[:6]}"
    store.refer(reference(sweep, purpose), [task.key for task in tasks])
    with StageProgress(console, tasks, store) as progress:
        failures = execute(tasks, store, backend, progress).failures
    for failure in failures.values():
        raise NoTraffic(failure.reason)
    grids = grids_of(store.load(trial.pog))
    if not problem.criteria.needs_objects:
        return Traffic(grids)
    assert trial.recall is not None
    objects = _objects(problem, store, trial.recall)
    frames = next(iter(grids.values())).frames
    console.print(
        f"expected_recall: {len(objects.objects.table):,} objects that count, in "
        f"{min(RECALL_FRAMES, frames)} of {frames} training frames"
    )
    return Traffic(grids, objects)


def _objects(problem: SearchProblem, store: Store, recall: Task[RecallStage]) -> ExpectedRecall:
    """Return the objects of the objectives, under rigs as clouds are collected."""
    file = problem.file
    objectives = [o for o in file.search.objective if o.by in OBJECT_SURROGATES]
    weighted = {name for objective in objectives for name in objective.weights_of(file.classes)}
    stage = replace(recall.stage, classes=tuple(name for name in file.classes if name in weighted))
    logs = [store.load(task) for task in tasks_of(SceneStage, recall.inputs)]
    model = stage.expected_recall(logs, azimuth_share=file.lidar.cloud_share)
    missing = weighted - set(model.objects.table["class"])
    if missing:
        raise NoTraffic(
            f"expected_recall: no {min(missing)} counts in the training frames; "
            "ask for the other classes, such as expected_recall.Car"
        )
    return model


@dataclass(frozen=True)
class Pool:
    """Workers that assess rigs on one traffic, which the backend shares out."""

    backend: Backend
    traffic: Traffic

    @classmethod
    def of(cls, backend: Backend, traffic: Traffic) -> Pool:
        """Share a traffic with the workers of a backend."""
        _fill_caches(traffic)
        return cls(backend, backend.share(traffic))

    def submit(self, rig: Rig, criteria: Criteria) -> Job[Assessment]:
        """Assess a rig in a worker."""
        return self.backend.submit(assess, rig, criteria, self.traffic)

    def in_order(self, rigs: Sequence[Rig], criteria: Criteria) -> list[Assessment]:
        """Assess several rigs at once."""
        jobs = [self.submit(rig, criteria) for rig in rigs]
        return [job.result() for job in jobs]


def _fill_caches(traffic: Traffic) -> None:
    """Compute once what every worker would compute by itself."""
    for grid in traffic.grids.values():
        grid.prepare()
    if traffic.objects is not None:
        _ = traffic.objects.objects.frames


PendingTrials = list[tuple[optuna.Trial, Rig]]
MeasuredValues = tuple[dict[int, list[float]], dict[int, str]]
"""Values of the measured objectives, and reasons of missing ones, by number of the trial."""


class SurrogateEvaluator:
    """Evaluate rigs by a pool of workers, batch by batch.

    `begin` takes up a trial of the next batch, and `finish` tells the study of the whole batch, in
    the order of the trials' numbers."""

    def __init__(self, study: optuna.Study, problem: SearchProblem, pool: Pool) -> None:
        self.study, self.problem, self._pool = study, problem, pool
        rig_of = problem.space.rig
        self._assessments = {rig_of(t.params): assessment_of(t) for t in finished_trials(study)}
        self._pending: PendingTrials = []
        self._jobs: dict[Rig, Job[Assessment]] = {}

    def run(self, report_finished: Callable[[int], None]) -> Timing:
        """Evaluate batches until there are enough trials; `report_finished` gets their number."""
        timing = Timing()
        while (batch := self._next_batch()) is not None:
            for number in batch:
                start = time.perf_counter()
                trial = self._ask(number)
                rig = self.problem.space.suggest(trial)
                timing.sampler += time.perf_counter() - start
                self.begin(trial, rig)
            start = time.perf_counter()
            self.finish()
            timing.evaluation += time.perf_counter() - start
            report_finished(batch[-1] + 1)
        return timing

    def _next_batch(self) -> list[int] | None:
        """Return numbers of the trials to finish next; None if there are enough."""
        trials, settings = self.study.get_trials(deepcopy=False), self.problem.file.search
        unfinished = [trial.number for trial in trials if not trial.state.is_finished()]
        first, size = min(unfinished, default=len(trials)), settings.batch_size
        start = first - first % size
        end = min(start + size, max(settings.trials, max(unfinished, default=-1) + 1))
        return [n for n in range(start, end) if n >= len(trials) or n in unfinished] or None

    def _ask(self, number: int) -> optuna.Trial:
        """Return trial `number`, new, or with the parameters that it had before a stop."""
        trials = self.study.get_trials(deepcopy=False)  # by number
        if number < len(trials) and trials[number].state == TrialState.RUNNING:
            return optuna.Trial(self.study, trials[number]._trial_id)
        return self.study.ask()

    def begin(self, trial: optuna.Trial, rig: Rig) -> None:
        """Assess the rig of a trial, unless an earlier trial had the same rig."""
        self._pending.append((trial, rig))
        if rig not in self._assessments and rig not in self._jobs:
            self._jobs[rig] = self._pool.submit(rig, self.problem.criteria)

    def finish(self) -> None:
        """Store the trials that have begun."""
        self._assessments |= {rig: job.result() for rig, job in self._jobs.items()}
        pending, self._pending, self._jobs = self._pending, [], {}
        feasible = [(trial, rig) for trial, rig in pending if self._assessments[rig].feasible]
        measured, failed = self._measure(feasible)
        unmeasured_too = not self.problem.uses_generalist
        for trial, rig in pending:
            assessment, values = self._assessments[rig], None
            if assessment.values is not None and (trial.number in measured or unmeasured_too):
                left = iter(measured.get(trial.number, ()))
                values = [
                    next(left) if o.measured else assessment.values[o.name]
                    for o in self.problem.criteria.objectives
                ]
                if any(map(math.isnan, values)):
                    reason = "an objective is undefined for this rig: nothing is covered"
                    failed[trial.number] = reason
            tell(self.study, trial, assessment, values, failed.get(trial.number))

    def _measure(self, pending: PendingTrials) -> MeasuredValues:
        """Measure rigs that keep all constraints by detectors."""
        return {}, {}
