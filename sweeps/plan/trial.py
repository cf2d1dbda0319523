"""What becomes of the points of a grid: their tasks, and all tasks of a sweep."""

import hashlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.ring_overlap import Interleaving
from lidarplace.pog.surrogates.sampling_error import SamplingError
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES
from lidarplace.requirements.layout import RequirementLayout
from sweeps.configuration.grid import GridPoint
from sweeps.configuration.sweep import Point
from sweeps.tasks import results as kinds
from sweeps.tasks.parameters import NetworkParams
from sweeps.tasks.task import Task
from training.typical_objects import TypicalObject


@dataclass(frozen=True)
class Trial:
    """What becomes of one point of the grid. `label`: "placement · detector · seed 1", and the
    further axes. `scene_label`: what its scene is called. `interleaving`: how its rings would lie
    between each other, where they coincide. `scenes`: the parts of its scene. `pog`, `surrogates`,
    `recall`: its cheap tasks, by which `promote` may rank; recall is None if no surrogate of
    objects is asked for. `accuracy`, `sampling_error`: None if they are not asked for, or of other
    placements."""

    grid_point: GridPoint
    label: str
    scene_label: str
    interleaving: Interleaving | None
    scenes: tuple[Task[BoxLog], ...]
    requirements: Task[kinds.Required] | None
    pog: Task[kinds.Pog]
    surrogates: Task[kinds.Scores]
    recall: Task[kinds.Scores] | None
    accuracy: Task[kinds.Accuracy] | None
    sampling_error: Task[SamplingError] | None

    @cached_property
    def key(self) -> str:
        """Names the trial: the same for the same work under the same name of the placement."""
        found = (self.deciding, *self.scores, *filter(None, [self.requirements]))
        parts = (self.grid_point.point.placement, *(task.key for task in found))
        return hashlib.sha256("/".join(parts).encode()).hexdigest()[:12]

    @property
    def deciding(self) -> Task:
        """The task whose result all that is measured comes from."""
        return self.pog

    @property
    def scores(self) -> tuple[Task[kinds.Scores], ...]:
        """The tasks whose results have tables of surrogates."""
        return (self.surrogates,) if self.recall is None else (self.surrogates, self.recall)

    def score_by(self, surrogate: str) -> Task[kinds.Scores]:
        """The one of `scores` that has a surrogate."""
        return self.scores[-1] if surrogate in OBJECT_SURROGATES else self.surrogates

    @cached_property
    def results(self) -> tuple[Task, ...]:
        """The tasks whose results the trial reports."""
        further = (self.requirements, self.accuracy, self.sampling_error)
        return (self.pog, *self.scores, *filter(None, further))


@dataclass(frozen=True)
class DetectorTrial(Trial):
    """A trial of a point with a detector. `ground_truths`, `collect_test`: of the parts of the
    scene. `finetune`: the training whose weights evaluate the placement, which is shared where a
    generalist does; None where a command does. `evaluate`: what the detector finds in the test
    frames."""

    ground_truths: tuple[Task[kinds.GroundTruth], ...]
    collect_test: tuple[Task[kinds.Collected], ...]
    finetune: Task[kinds.Trained] | None
    evaluate: Task[kinds.Evaluated]

    @property
    def test_truths(self) -> list[Task[kinds.GroundTruth]]:
        """Of the test frames; those of a training log may have the same numbers."""
        return [task for task in self.evaluate.inputs if task.stage == "ground_truth"]

    @property
    def learns(self) -> Task:
        """The training, or the command."""
        return self.finetune or self.evaluate.inputs[0]

    @property
    def deciding(self) -> Task:
        return self.evaluate

    @cached_property
    def results(self) -> tuple[Task, ...]:
        return (*super().results, self.learns, self.evaluate)


def with_detector(trials: Iterable[Trial]) -> list[DetectorTrial]:
    return [trial for trial in trials if isinstance(trial, DetectorTrial)]


@dataclass(frozen=True)
class Plan:
    """All tasks, each once and after its inputs, and the trials that they make up. `laid`: what is
    required, around the vehicle; by the curves of the first trial. `cautions`: what is to be known
    of the classes of the logs, a sentence each."""

    tasks: tuple[Task, ...]
    trials: tuple[Trial, ...]
    laid: tuple[RequirementLayout, ...] = ()
    cautions: tuple[str, ...] = ()

    @property
    def typical(self) -> tuple[TypicalObject, ...]:
        """Objects of which anchors are, of classes that have not the preset's; each once."""
        params = (t.params for t in self.tasks if isinstance(t.params, NetworkParams))
        return tuple(dict.fromkeys(item for own in params for item in own.typical))

    def needed_for(self, results: Iterable[Task]) -> list[Task]:
        """The tasks that lead to `results`, and these, in the order of the plan."""
        needed: set[str] = set()
        open_ = list(results)
        while open_:
            task = open_.pop()
            if task.key not in needed:
                needed.add(task.key)
                open_ += task.inputs
        return [task for task in self.tasks if task.key in needed]


def task_label(grid_point: GridPoint, keys: Collection[str], *names: str) -> str:
    """The placement and the axes among `keys` of the configuration, or the scene; then `names`."""
    parts = [grid_point.point.placement] if "placement" in keys else []
    parts += [
        f"{axis}={value}"
        for axis, value in grid_point.axes.items()
        if axis != "placement" and any(_is_inside(axis, k) or _is_inside(k, axis) for k in keys)
    ]
    return " · ".join([*(parts or [grid_point.point.scene.name]), *filter(None, names)])


def _is_inside(key_path: str, other: str) -> bool:
    return f"{key_path}.".startswith(f"{other}.")


def trial_label(point: Point, axes: Mapping[str, Any]) -> str:
    """The placement, detector, seed and the further axes of a point."""
    others = (axis for axis in axes if axis not in ("placement", "detector", "seed"))
    further = [f"{axis}={axes[axis]}" for axis in others]
    detector = point.detector_name
    detected = [detector, f"seed {point.seed}"] if detector else []
    return " · ".join([point.placement, *detected, *further])
