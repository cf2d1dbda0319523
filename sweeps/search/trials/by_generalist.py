"""Evaluation of trials by a generalist: all on some frames, those that lead on all frames.

A rig that goes on is among the best third of all so far on the same frames (asynchronous successive
halving, Li et al. 2020, decided batch by batch, so that it does not matter which was faster). In
several tests, such as towns, a portion of the frames is one of each. The others have the value on
all frames that is expected from the first, by a regression over those that have both."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np
import optuna
import pandas as pd

from lidarplace.base.metrics import Overlaps
from sweeps.configuration.objective import ObjectiveSettings
from sweeps.execution.backends import Backend, Job
from sweeps.execution.execute import Listener, execute
from sweeps.plan.trial import DetectorTrial
from sweeps.search.problem.generalist_trials import TrialsOfRig, generalists, trials_of_rigs
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.trials.aggregate import metrics_over_tests, weighted_value
from sweeps.search.trials.study import finished_trials
from sweeps.search.trials.traffic import MeasuredValues, PendingTrials, Pool, SurrogateEvaluator
from sweeps.stages.collect import CollectStage
from sweeps.stages.evaluate import DetectStage, EvaluateStage
from sweeps.stages.ground_truth import GroundTruthStage
from sweeps.stages.measure import EvaluationResult
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task, tasks_of, with_inputs
from sweeps.store.local import Store
from sweeps.store.open import reference

PORTIONS = 4
"""Number of portions of the frames; the first portion is one of them."""
KEPT = 3
"""Inverse share of the rigs that go on to all frames."""
_FIRST, _WHOLE = "value on the first frames", "value on all frames"
"""User attributes of a trial."""


class GeneralistEvaluator(SurrogateEvaluator):
    """Evaluate trials by a detector that is trained once, on rigs of the space, or by a file.

    Rigs that violate a constraint are not measured. With several objectives all rigs see all
    frames. Results stay in the store, so a stop loses nothing."""

    def __init__(
        self,
        study: optuna.Study,
        problem: SearchProblem,
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

    def _measure(self, pending: PendingTrials) -> MeasuredValues:
        """Evaluate detections in the first frames, then in all frames for the best."""
        if not pending:
            return {}, {}
        problem, trials = self.problem, {trial.number: trial for trial, _ in pending}
        outside = {t.number: why for t, rig in pending if (why := problem.outside(rig)) is not None}
        rigs = {f"trial_{t.number}": rig for t, rig in pending if t.number not in outside}
        by_name = trials_of_rigs(problem, self._generalists, rigs, problem.tests.search)
        by_number = {int(name.removeprefix("trial_")): tests for name, tests in by_name.items()}
        measured = [o for o in problem.file.search.objective if o.measured]
        if len(measured) > 1:
            values, failed = self._values(by_number, measured, range(PORTIONS))
            return values, outside | failed
        first, failed = self._values(by_number, measured, range(1))
        for number, (value,) in first.items():
            trials[number].set_user_attr(_FIRST, value)
        leading = {n: by_number[n] for n in self._leading(first, measured[0])}
        whole, failed_later = self._values(leading, measured, range(PORTIONS))
        for number, (value,) in whole.items():
            trials[number].set_user_attr(_WHOLE, value)
        both = [
            (trial.user_attrs[_FIRST], trial.user_attrs[_WHOLE])
            for trial in finished_trials(self.study)
            if _WHOLE in trial.user_attrs
        ]
        both += [(first[number][0], value) for number, (value,) in whole.items()]
        values = {n: [expected_on_all(value, both)] for n, (value,) in first.items()} | whole
        return values, outside | failed | failed_later

    def _leading(self, first: dict[int, list[float]], objective: ObjectiveSettings) -> list[int]:
        """Return numbers of trials among the best of all so far on the first frames."""
        sign = 1 if objective.best == "maximize" else -1
        seen = [t.user_attrs[_FIRST] for t in finished_trials(self.study) if _FIRST in t.user_attrs]
        every = sign * np.array([*seen, *(value for (value,) in first.values())])
        least = np.quantile(every, 1 - 1 / KEPT) if len(every) else math.inf
        return [number for number, (value,) in first.items() if sign * value >= least]

    def _values(
        self,
        by_number: Mapping[int, TrialsOfRig],
        objectives: Sequence[ObjectiveSettings],
        portions: range,
    ) -> MeasuredValues:
        """Return values on portions of the frames, mean over the generalists; and failures."""
        needed = {
            number: with_inputs(
                task
                for tests in tests_by_seed
                for trial in tests
                for task in [*_detection_tasks(trial, portions), *trial.test_truths]
            )
            for number, tests_by_seed in by_number.items()
        }
        tasks = with_inputs(task for inputs in needed.values() for task in inputs)
        self._referred |= {task.key for task in tasks}
        self.store.refer(self._reference, self._referred)  # from now on
        failures = execute(tasks, self.store, self.backend, self._listener).failures
        file, failed = self.problem.file, dict[int, str]()

        def submit(trial: DetectorTrial) -> Job[pd.DataFrame]:
            tasks = _detection_tasks(trial, portions), trial.test_truths
            evaluation = (file.classes, file.own_ious(), file.metrics)
            return self.backend.submit(metrics_of_portions, self.store, *tasks, *evaluation)

        jobs = {}
        for number, tests_by_seed in by_number.items():
            reasons = [failures[t.key].reason for t in needed[number] if t.key in failures]
            if reasons:
                failed[number] = reasons[0]
            else:
                jobs[number] = [[submit(trial) for trial in tests] for tests in tests_by_seed]
        values, over = {}, file.search.over
        for number, jobs_by_seed in jobs.items():
            tables = [metrics_over_tests([job.result() for job in of], over) for of in jobs_by_seed]
            means = [
                fmean(weighted_value(objective, file.classes, table) for table in tables)
                for objective in objectives
            ]
            if any(map(math.isnan, means)):
                failed[number] = "no object of the class in the test frames"
            else:
                values[number] = means
        return values, failed


def expected_on_all(first: float, both: Sequence[tuple[float, float]]) -> float:
    """Predict the value on all frames from the value on the first ones.

    `both`: values of rigs that have both. Rigs were sent on because they led on the first frames,
    so on all frames they are closer to the others than they were. The regression on the first value
    does not depend on that selection. Its slope is kept between that of frames which have nothing
    to do with the first, 1 / `PORTIONS`, and 1; with fewer than 3 pairs it is 1."""
    if not both:
        return first
    x, y = np.array(both).T
    spread = float(((x - x.mean()) ** 2).sum())
    slope = 1.0
    if len(x) > 2 and spread > 0:
        slope = float(np.clip(((x - x.mean()) * y).sum() / spread, 1 / PORTIONS, 1))
    return float(y.mean() + slope * (first - x.mean()))


def metrics_of_portions(
    store: Store,
    portions: Sequence[Task[DetectStage]],
    truths: Sequence[Task[GroundTruthStage]],
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
    metrics: Sequence[str],
) -> pd.DataFrame:
    """Compute metrics of one rig from its detections in portions of the frames.

    See `training.kitti_ap.evaluation`."""
    from training.kitti_ap import evaluation

    detections = [store.load(task) for task in portions]
    objects = [store.read(task, lambda truth: truth.objects) for task in truths]
    frames = pd.concat([portion.frames["frame"] for portion in detections])
    return evaluation(
        pd.concat(objects, ignore_index=True),
        pd.concat([portion.detections for portion in detections], ignore_index=True),
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
    every` … of each part of the scene."""
    network, (weights, *inputs) = evaluate.stage, evaluate.inputs
    assert isinstance(network, EvaluateStage)
    collected = tasks_of(CollectStage, inputs)
    collection = replace(collected[0].stage, first=first, every=every)
    stage = DetectStage(**vars(network) | {"ious": (), "metrics": ()}, collection=collection)
    label = f"{evaluate.label} · frames {first + 1} of {every}"
    return Task(stage, label, (weights, *(scene for task in collected for scene in task.inputs)))


def _detection_tasks(trial: DetectorTrial, portions: range) -> list[Task[DetectStage]]:
    return [detect_task(trial.evaluate, portion, PORTIONS) for portion in portions]
