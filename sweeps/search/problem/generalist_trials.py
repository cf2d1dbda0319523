"""Rigs of a search as trials of a sweep that a generalist evaluates."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from lidarplace import PAPER_PLACEMENTS
from lidarplace.base.errors import at
from sweeps.configuration.file import ConfigError
from sweeps.configuration.objective import PRETRAINED
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import DetectorTrial, with_detector
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import MountedLidar, Rig, ordered
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage

TrialsOfRig = Sequence[Sequence[DetectorTrial]]
"""Trials of one rig: for every generalist one for each test."""


def generalists(problem: SearchProblem) -> dict[int, Task[FinetuneStage]]:
    """Return the trainings of the generalists by seed; none if the generalist is that of a file."""
    if problem.pretrained:
        return {}
    rigs = dict(problem.training_rigs)
    settings = problem.file.generalist
    if isinstance(settings.rigs, int):
        settings = settings.model_copy(update={"rigs": tuple(rigs)})
    changes = {"evaluator": "generalist", "generalist": settings}
    # Any rig of a model of the space, under a name that is not trained on.
    model, line = problem.space.models[0], PAPER_PLACEMENTS["line"]
    lidars = (MountedLidar(model, "", mount) for mount in line.mounts)
    evaluated = next(iter(rigs.values()), ordered(lidars))
    trials = _trials(problem, {"evaluated": evaluated}, rigs, changes)
    return {t.grid_point.point.seed: t.finetune for t in trials if t.finetune is not None}


def trials_of_rigs(
    problem: SearchProblem,
    trained: Mapping[int, Task[FinetuneStage]],
    rigs: Mapping[str, Rig],
    tests: Sequence[Mapping[str, Any]],
) -> dict[str, TrialsOfRig]:
    """Return the trials in which generalists evaluate rigs, by the rig's name.

    `trained`: generalists by seed; empty for that of a file. `tests`: changes of the configuration
    by key path, one for each test."""
    trials: dict[str, dict[int, list[DetectorTrial]]] = {
        name: {seed: [] for seed in problem.file.search.seeds} for name in rigs
    }
    evaluator = {"evaluator": PRETRAINED} if problem.pretrained else {}
    for changes in tests:
        for trial in _trials(problem, rigs, {}, {**changes, **evaluator}):
            point = trial.grid_point.point
            if trained:  # the detections are those of the generalist
                training, (_, *inputs) = trained[point.seed], trial.evaluate.inputs
                evaluate = replace(trial.evaluate, inputs=(training, *inputs))
                trial = replace(trial, finetune=training, evaluate=evaluate)
            trials[point.placement][point.seed].append(trial)
    return {name: list(by_seed.values()) for name, by_seed in trials.items()}


def _trials(
    problem: SearchProblem,
    rigs: Mapping[str, Rig],
    others: Mapping[str, Rig],
    changes: Mapping[str, Any],
) -> list[DetectorTrial]:
    """Return the trials of rigs with the seeds of the search; `others` are placements, too."""
    with at(problem.path, ConfigError):
        sweep = problem.sweep_of({**others, **rigs}, list(rigs), changes)
        return with_detector(make_plan(sweep).trials)
