"""Rigs of a search as trials of a sweep that a generalist judges."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from lidarplace import PAPER_PLACEMENTS
from lidarplace.base.errors import at
from sweeps.configuration.file import ConfigError
from sweeps.configuration.search import PRETRAINED
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import DetectorTrial, with_detector
from sweeps.search.problem.choice import Choice, Choices, ordered
from sweeps.search.problem.problem import Problem
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage

JudgedRig = Sequence[Sequence[DetectorTrial]]
"""A rig's trials: of every generalist one for each test."""


def generalists(problem: Problem) -> dict[int, Task[FinetuneStage]]:
    """The trainings of the generalists by seed; none where it is that of a file."""
    if problem.pretrained:
        return {}
    rigs = dict(problem.training_rigs)
    settings = problem.file.generalist
    if isinstance(settings.rigs, int):
        settings = settings.model_copy(update={"rigs": tuple(rigs)})
    changes = {"evaluator": "generalist", "generalist": settings}
    # Whichever, of a model of the space, and not trained on by its name.
    model, line = problem.space.models[0], PAPER_PLACEMENTS["line"]
    some = next(iter(rigs.values()), ordered(Choice(model, "", mount) for mount in line.mounts))
    trials = _trials(problem, {"judged": some}, rigs, changes)
    return {t.grid_point.point.seed: t.finetune for t in trials if t.finetune is not None}


def judged_rigs(
    problem: Problem,
    trained: Mapping[int, Task[FinetuneStage]],
    rigs: Mapping[str, Choices],
    tests: Sequence[Mapping[str, Any]],
) -> dict[str, JudgedRig]:
    """The trials in which generalists evaluate rigs: those `trained` by seed, or that of a file; on
    `tests`, changes of the configuration by key path."""
    found: dict[str, dict[int, list[DetectorTrial]]] = {
        name: {seed: [] for seed in problem.file.search.seeds} for name in rigs
    }
    evaluator = {"evaluator": PRETRAINED} if problem.pretrained else {}
    for changes in tests:
        for trial in _trials(problem, rigs, {}, {**changes, **evaluator}):
            point = trial.grid_point.point
            if trained:  # the detections are those of the generalist
                own, (_, *inputs) = trained[point.seed], trial.evaluate.inputs
                evaluate = replace(trial.evaluate, inputs=(own, *inputs))
                trial = replace(trial, finetune=own, evaluate=evaluate)
            found[point.placement][point.seed].append(trial)
    return {name: list(by_seed.values()) for name, by_seed in found.items()}


def _trials(
    problem: Problem,
    rigs: Mapping[str, Choices],
    others: Mapping[str, Choices],
    changes: Mapping[str, Any],
) -> list[DetectorTrial]:
    """Those of a sweep of rigs with the seeds of the search; `others` are placements, too."""
    with at(problem.path, ConfigError):
        sweep = problem.sweep_of({**others, **rigs}, list(rigs), changes)
        return with_detector(make_plan(sweep).trials)
