"""Candidates judged by a generalist: on some frames all of them, on all frames those that lead.

A rig that goes on is among the best third of all so far on the same frames (asynchronous successive
halving, Li et al. 2020, decided batch by batch, so that it does not matter which was faster). In
several tests, such as towns, a portion of the frames is one of each. The others have the value on
all frames that is expected from the first, by a regression over those that have both.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np
import optuna
import pandas as pd

from lidarplace.base.metrics import Overlaps
from sweeps.configuration.search import ObjectiveSettings
from sweeps.execution.backends import Backend, Job
from sweeps.execution.execute import Listener, execute
from sweeps.plan.trial import DetectorTrial
from sweeps.search.problem.judged_sweep import JudgedRig, generalists, judged_rigs
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.aggregate import metrics_over_tests, weighted_value
from sweeps.search.trials.study import finished_trials
from sweeps.search.trials.traffic import Asked, Measured, Pool, SurrogateAnswers
from sweeps.stages.collect import CollectStage
from sweeps.stages.evaluate import DetectStage, EvaluateStage, EvaluationResult
from sweeps.stages.ground_truth import GroundTruthStage
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task, tasks_of, with_inputs
from sweeps.store.local import Store
from sweeps.store.open import reference

PORTIONS = 4
"""The first portion of the frames is one of so many."""
KEPT = 3
"""One of so many rigs goes on to all frames."""
_FIRST, _WHOLE = "value on the first frames", "value on all frames"
"""User attributes of a trial."""


class GeneralistAnswers(SurrogateAnswers):
    """Answers by a detector that is trained once, on rigs of the space, or by that of a file. Rigs
    that violate a constraint are not measured. With several objectives all rigs see all frames.
    Results stay in the store, so a stop loses nothing."""

    def __init__(
        self,
        study: optuna.Study,
        problem: Problem,
        pool: Pool,
        store: Store,
        backend: Backend,
        listener: Listener,
    ) -> None:
        super().__init__(study, problem, pool)
        self.store, self.backend, self._listener = store, backend, listener
        self._generalists = generalists(problem)
        self._reference = reference(problem.sweep(), "judged")
        self._referred = set(store.references().get(self._reference, ()))

    def _measure(self, asked: Asked) -> Measured:
        """Detections in the first frames, then in all frames for the best."""
        if not asked:
            return {}, {}
        problem, trials = self.problem, {trial.number: trial for trial, _ in asked}
        outside = {t.number: why for t, rig in asked if (why := problem.outside(rig)) is not None}
        rigs = {f"trial_{t.number}": rig for t, rig in asked if t.number not in outside}
        judged = judged_rigs(problem, self._generalists, rigs, problem.tests.search)
        by_number = {int(name.removeprefix("trial_")): own for name, own in judged.items()}
        measured = [o for o in problem.file.search.objective if o.measured]
        if len(measured) > 1:
            values, failed = self._values(by_number, measured, range(PORTIONS))
            return values, outside | failed
        first, failed = self._values(by_number, measured, range(1))
        for number, own in first.items():
            trials[number].set_user_attr(_FIRST, own[0])
        going_on = {n: by_number[n] for n in self._leading(first, measured[0])}
        whole, failed_later = self._values(going_on, measured, range(PORTIONS))
        for number, own in whole.items():
            trials[number].set_user_attr(_WHOLE, own[0])
        both = [
            (trial.user_attrs[_FIRST], trial.user_attrs[_WHOLE])
            for trial in finished_trials(self.study)
            if _WHOLE in trial.user_attrs
        ]
        both += [(first[number][0], own[0]) for number, own in whole.items()]
        values = {n: [expected_on_all(own[0], both)] for n, own in first.items()} | whole
        return values, outside | failed | failed_later

    def _leading(self, first: dict[int, list[float]], objective: ObjectiveSettings) -> list[int]:
        """Numbers of those among the best of all so far on the first frames."""
        sign = 1 if objective.best == "maximize" else -1
        seen = [t.user_attrs[_FIRST] for t in finished_trials(self.study) if _FIRST in t.user_attrs]
        every = sign * np.array([*seen, *(own[0] for own in first.values())])
        least = np.quantile(every, 1 - 1 / KEPT) if len(every) else math.inf
        return [number for number, own in first.items() if sign * own[0] >= least]

    def _values(
        self,
        by_number: Mapping[int, JudgedRig],
        objectives: Sequence[ObjectiveSettings],
        portions: range,
    ) -> Measured:
        """Values on portions of the frames, mean over the generalists; and failures."""
        needed = {
            number: with_inputs(
                task
                for tests in own
                for trial in tests
                for task in [*_judging(trial, portions), *trial.test_truths]
            )
            for number, own in by_number.items()
        }
        tasks = with_inputs(task for own in needed.values() for task in own)
        self._referred |= {task.key for task in tasks}
        self.store.refer(self._reference, self._referred)  # from now on
        failures = execute(tasks, self.store, self.backend, self._listener).failures
        file, failed = self.problem.file, dict[int, str]()

        def submit(trial: DetectorTrial) -> Job[pd.DataFrame]:
            tasks = _judging(trial, portions), trial.test_truths
            own = (file.classes, file.own_ious(), file.metrics)
            return self.backend.submit(judged_metrics, self.store, *tasks, *own)

        jobs = {}
        for number, own in by_number.items():
            reasons = [failures[t.key].reason for t in needed[number] if t.key in failures]
            if reasons:
                failed[number] = reasons[0]
            else:
                jobs[number] = [[submit(trial) for trial in tests] for tests in own]
        values, over = {}, file.search.over
        for number, of_seeds in jobs.items():
            tables = [metrics_over_tests([job.result() for job in own], over) for own in of_seeds]
            found = [
                fmean(weighted_value(objective, file.classes, own) for own in tables)
                for objective in objectives
            ]
            if any(map(math.isnan, found)):
                failed[number] = "no object of the class in the test frames"
            else:
                values[number] = found
        return values, failed


def expected_on_all(first: float, both: Sequence[tuple[float, float]]) -> float:
    """The value on all frames that a value on the first frames lets expect; `both`: of rigs that
    have both.

    Rigs were sent on because they led on the first frames, so on all frames they are closer to the
    others than they were. The regression on the first value does not depend on that selection. Its
    slope is kept between that of frames which have nothing to do with the first, 1 / `PORTIONS`,
    and 1; with fewer than 3 pairs it is 1.
    """
    if not both:
        return first
    x, y = np.array(both).T
    spread = float(((x - x.mean()) ** 2).sum())
    slope = 1.0
    if len(x) > 2 and spread > 0:
        slope = float(np.clip(((x - x.mean()) * y).sum() / spread, 1 / PORTIONS, 1))
    return float(y.mean() + slope * (first - x.mean()))


def judged_metrics(
    store: Store,
    portions: Sequence[Task[DetectStage]],
    truths: Sequence[Task[GroundTruthStage]],
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
    metrics: Sequence[str],
) -> pd.DataFrame:
    """Metrics of one rig from its detections in portions of the frames, see `evaluate_boxes`."""
    from training.kitti_ap import evaluation

    found = [store.load(task) for task in portions]
    objects = [store.read(task, lambda truth: truth.objects) for task in truths]
    frames = pd.concat([judged.frames["frame"] for judged in found])
    return evaluation(
        pd.concat(objects, ignore_index=True),
        pd.concat([judged.detections for judged in found], ignore_index=True),
        frames.tolist(),
        classes,
        ious=ious,
        metrics=metrics,
    ).metrics


def detect_task(
    evaluate: Task[Stage[EvaluationResult]], first: int, every: int
) -> Task[DetectStage]:
    """Return the task of the detections that `evaluate` compares, without kept clouds.

    `evaluate`: of a rig whose clouds are simulated. `first`, `every`: frames `first`, `first +
    every` … of each part of the scene.
    """
    network, (weights, *inputs) = evaluate.stage, evaluate.inputs
    assert isinstance(network, EvaluateStage)
    collected = tasks_of(CollectStage, inputs)
    collection = replace(collected[0].stage, first=first, every=every)
    stage = DetectStage(**vars(network) | {"ious": (), "metrics": ()}, collection=collection)
    label = f"{evaluate.label} · frames {first + 1} of {every}"
    return Task(stage, label, (weights, *(scene for task in collected for scene in task.inputs)))


def _judging(trial: DetectorTrial, portions: range) -> list[Task[DetectStage]]:
    return [detect_task(trial.evaluate, portion, PORTIONS) for portion in portions]
