"""The tasks of one point of a grid, and all tasks of a sweep."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from lidarplace.mounting.ring_overlap import Interleaving
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES
from lidarplace.requirements.layout import RequirementLayout
from sweeps.configuration.grid import GridPoint
from sweeps.stages.collect import CollectStage, RecordedCloudsStage
from sweeps.stages.ground_truth import GroundTruthStage
from sweeps.stages.measure import EvaluationResult
from sweeps.stages.pog import PogStage
from sweeps.stages.recall import RecallStage
from sweeps.stages.requirements import RequirementsStage
from sweeps.stages.scene import SceneStage
from sweeps.stages.stage import Stage
from sweeps.stages.surrogates import Scores, SurrogatesStage
from sweeps.stages.task import Task, tasks_of
from sweeps.stages.train import FinetuneStage, Network
from training.typical_objects import TypicalObject

CloudTask = Task[CollectStage | RecordedCloudsStage]


@dataclass(frozen=True)
class Trial:
    """The work of one point of the grid.

    `label`: "placement · detector · seed 1", and the further axes. `scene_label`: names its scene.
    `interleaving`: how its rings would interleave, where they coincide. `scenes`: the parts of its
    scene. `pog`, `surrogates`, `recall`: its cheap tasks, by which `promote` may rank; recall is
    None without surrogates of objects. `studies`: further tasks that it reports."""

    grid_point: GridPoint
    label: str
    scene_label: str
    interleaving: Interleaving | None
    scenes: tuple[Task[SceneStage], ...]
    requirements: Task[RequirementsStage] | None
    pog: Task[PogStage]
    surrogates: Task[SurrogatesStage]
    recall: Task[RecallStage] | None
    studies: tuple[Task, ...]

    @cached_property
    def key(self) -> str:
        """Name of the trial: the same for the same work under the same name of the placement."""
        tasks = (self.deciding, *self.scores, *filter(None, [self.requirements]))
        parts = (self.grid_point.point.placement, *(task.key for task in tasks))
        return hashlib.sha256("/".join(parts).encode()).hexdigest()[:12]

    @property
    def deciding(self) -> Task:
        """The task whose result all measured values come from."""
        return self.pog

    @property
    def scores(self) -> tuple[Task[Stage[Scores]], ...]:
        """The tasks whose results have tables of surrogates."""
        return (self.surrogates,) if self.recall is None else (self.surrogates, self.recall)

    def score_by(self, surrogate: str) -> Task[Stage[Scores]]:
        """Return the one of `scores` that computes a surrogate."""
        return self.scores[-1] if surrogate in OBJECT_SURROGATES else self.surrogates

    @cached_property
    def results(self) -> tuple[Task, ...]:
        """The tasks whose results the trial reports."""
        requirements = filter(None, [self.requirements])
        return (self.pog, *self.scores, *requirements, *self.studies)


@dataclass(frozen=True)
class DetectorTrial(Trial):
    """A trial of a point with a detector.

    `ground_truths`, `collect_test`: of the parts of the scene. `finetune`: the training whose
    weights evaluate the placement, shared where it is that of a generalist; None where pretrained
    weights or a command do. `evaluate`: compares detections in the test frames with the truth."""

    ground_truths: tuple[Task[GroundTruthStage], ...]
    collect_test: tuple[CloudTask, ...]
    finetune: Task[FinetuneStage] | None
    evaluate: Task[Stage[EvaluationResult]]

    @property
    def test_truths(self) -> list[Task[GroundTruthStage]]:
        """Ground truth of the test frames; a training log may have frames of the same numbers."""
        return tasks_of(GroundTruthStage, self.evaluate.inputs)

    @property
    def learns(self) -> Task:
        """The training, the pretrained weights or the command."""
        return self.finetune or self.evaluate.inputs[0]

    @property
    def deciding(self) -> Task:
        return self.evaluate

    @cached_property
    def results(self) -> tuple[Task, ...]:
        return (*super().results, self.learns, self.evaluate)


def with_detector(trials: Iterable[Trial]) -> list[DetectorTrial]:
    """Select the trials with a detector."""
    return [trial for trial in trials if isinstance(trial, DetectorTrial)]


@dataclass(frozen=True)
class Plan:
    """The tasks of a sweep, each once and after its inputs, and its trials.

    `layouts`: the requirements around the vehicle, by the curves of the first trial. `cautions`:
    what the user is to know of the classes of the logs and of the settings, a sentence each."""

    tasks: tuple[Task, ...]
    trials: tuple[Trial, ...]
    layouts: tuple[RequirementLayout, ...] = ()
    cautions: tuple[str, ...] = ()

    @property
    def networks(self) -> list[Network]:
        """Stages with a network."""
        return [task.stage for task in self.tasks if isinstance(task.stage, Network)]

    @property
    def typical(self) -> tuple[TypicalObject, ...]:
        """Objects of the classes that have no anchors in a preset; each once."""
        return tuple(dict.fromkeys(item for network in self.networks for item in network.typical))

    def needed_for(self, results: Iterable[Task]) -> list[Task]:
        """List the tasks that lead to `results`, and these, in the order of the plan."""
        needed: set[str] = set()
        queue = list(results)
        while queue:
            task = queue.pop()
            if task.key not in needed:
                needed.add(task.key)
                queue += task.inputs
        return [task for task in self.tasks if task.key in needed]
