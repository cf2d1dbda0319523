"""The training traffic of a search, and rigs that are assessed on it by a pool of workers."""

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
from sweeps.search.problem.assess import Assessment, Question, Traffic, assess
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import Timing, assessment_of, finished_trials, tell
from sweeps.stages.pog import grids_of
from sweeps.stages.recall import RecallStage
from sweeps.stages.scene import SceneStage
from sweeps.stages.task import Task, tasks_of
from sweeps.store.local import Store
from sweeps.store.open import reference


class NoTraffic(RuntimeError):
    """A task that leads to the traffic failed, or nothing is in it."""


def training_traffic(
    console: Console,
    problem: Problem,
    store: Store,
    backend: Backend,
    scene: Mapping[str, Any] | None = None,
) -> Traffic:
    """What the objectives ask for. `scene`: key path -> value, what differs from the configuration.
    Raises ConfigError: a value is not allowed at its key path; NoTraffic: something failed, or
    `expected_recall` is asked of a class of which no object counts."""
    if not any(objective.of_traffic for objective in problem.question.objectives):
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
    if not problem.question.needs_objects:
        return Traffic(grids)
    assert trial.recall is not None
    objects = _objects(problem, store, trial.recall)
    frames = next(iter(grids.values())).frames
    console.print(
        f"expected_recall: {len(objects.objects.table):,} objects that count, in "
        f"{min(RECALL_FRAMES, frames)} of {frames} training frames"
    )
    return Traffic(grids, objects)


def _objects(problem: Problem, store: Store, recall: Task[RecallStage]) -> ExpectedRecall:
    """The objects of which the objectives are, under rigs as clouds are collected."""
    file = problem.file
    asked = [o for o in file.search.objective if o.by in OBJECT_SURROGATES]
    weighted = {name for objective in asked for name in objective.weights_of(file.classes)}
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
    """Assesses rigs on one traffic, which the backend shares out."""

    backend: Backend
    traffic: Traffic

    @classmethod
    def of(cls, backend: Backend, traffic: Traffic) -> Pool:
        for grid in traffic.grids.values():
            grid.levels, grid.h_pog  # noqa: B018 - worked out once, not by every worker
        if traffic.objects is not None:
            traffic.objects.objects.frames  # noqa: B018 - as well
        return cls(backend, backend.share(traffic))

    def submit(self, rig: Choices, question: Question) -> Job[Assessment]:
        return self.backend.submit(assess, rig, question, self.traffic)

    def in_order(self, rigs: Sequence[Choices], question: Question) -> list[Assessment]:
        """Of several rigs at once."""
        jobs = [self.submit(rig, question) for rig in rigs]
        return [job.result() for job in jobs]


Asked = list[tuple[optuna.Trial, Choices]]
Measured = tuple[dict[int, list[float]], dict[int, str]]
"""Values of the measured objectives, and reasons why there are none, by number of the trial."""


class SurrogateAnswers:
    """Evaluates rigs by a pool of workers: `begin` takes up one of the next batch, and `finish`
    tells the study of the whole batch, in the order of the trials' numbers."""

    def __init__(self, study: optuna.Study, problem: Problem, pool: Pool) -> None:
        self.study, self.problem, self._pool = study, problem, pool
        known = finished_trials(study)
        self._known = {problem.space.rig(trial.params): assessment_of(trial) for trial in known}
        self._asked: Asked = []
        self._jobs: dict[Choices, Job[Assessment]] = {}

    def run(self, told: Callable[[int], None]) -> Timing:
        """Ask and tell until there are enough trials; `told`: gets the number of finished ones."""
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
            told(batch[-1] + 1)
        return timing

    def _next_batch(self) -> list[int] | None:
        """Numbers of the trials to finish next; None if there are enough."""
        trials, settings = self.study.get_trials(deepcopy=False), self.problem.file.search
        unfinished = [trial.number for trial in trials if not trial.state.is_finished()]
        first, size = min(unfinished, default=len(trials)), settings.batch_size
        start = first - first % size
        end = min(start + size, max(settings.trials, max(unfinished, default=-1) + 1))
        return [n for n in range(start, end) if n >= len(trials) or n in unfinished] or None

    def _ask(self, number: int) -> optuna.Trial:
        """Trial `number`, new, or as a stop left it: what it has been asked for stays."""
        known = self.study.get_trials(deepcopy=False)  # by number
        if number < len(known) and known[number].state == TrialState.RUNNING:
            return optuna.Trial(self.study, known[number]._trial_id)
        return self.study.ask()

    def begin(self, trial: optuna.Trial, rig: Choices) -> None:
        self._asked.append((trial, rig))
        if rig not in self._known and rig not in self._jobs:
            self._jobs[rig] = self._pool.submit(rig, self.problem.question)

    def finish(self) -> None:
        self._known |= {rig: job.result() for rig, job in self._jobs.items()}
        asked, self._asked, self._jobs = self._asked, [], {}
        measured, failed = self._measure([own for own in asked if self._known[own[1]].feasible])
        for trial, rig in asked:
            found, values = self._known[rig], None
            if found.values is not None and (trial.number in measured or not self.problem.judged):
                left = iter(measured.get(trial.number, ()))
                values = [
                    next(left) if o.measured else found.values[o.name]
                    for o in self.problem.question.objectives
                ]
                if any(map(math.isnan, values)):
                    reason = "an objective is undefined for this rig: nothing is covered"
                    failed[trial.number] = reason
            tell(self.study, trial, found, values, failed.get(trial.number))

    def _measure(self, asked: Asked) -> Measured:
        """What detectors measure of rigs that keep all constraints."""
        return {}, {}
