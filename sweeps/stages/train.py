"""The stages that train a detector, or read one that is trained."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypedDict, Unpack

import pandas as pd

from lidarplace.base.code_version import OMIT_DEFAULT
from lidarplace.base.errors import InputError
from lidarplace.base.metrics import Overlaps
from lidarplace.clouds.clouds import Clouds, Crop
from sweeps.stages.collect import CollectedClouds, clouds_and_objects
from sweeps.stages.ground_truth import GroundTruth
from sweeps.stages.stage import Need, R, Stage, of_type
from training import code_of_network, network_of
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True, eq=False)
class TrainedDetector:
    """A detector: the fields of `training.finetune.FinetuneResult`, and the classes it detects."""

    state_dict: Mapping[str, Tensor]
    curve: pd.DataFrame
    classes: Sequence[str]
    batch_size: int
    batch_size_reduced: bool
    weights: str
    earlier_seconds: float


class TrainingRun(TypedDict):
    """Circumstances of a training that do not decide its result.

    `folder`: where it goes on after a stop. `halvings`: how often the batch size is halved, after
    the GPU's memory was too small. `on_step`: called with the number of epochs that are done."""

    folder: Path
    halvings: int
    on_step: Callable[[float], None]


@dataclass(frozen=True)
class Network(Stage[R]):
    """A stage with a network: what it detects, how it is trained and selects boxes.

    `point_range`: the crop of the clouds. `typical`: objects of which anchors are, for classes
    without those of the preset. `ious`: of classes that are evaluated at other overlaps than
    KITTI's, and `metrics`: of plug-ins; both where detections are evaluated. `gpu`: whether
    pretrained weights are evaluated on a GPU, whose last digits differ from a CPU's; None: networks
    that are trained, on either."""

    detector: str
    classes: tuple[str, ...]
    training: TrainingSettings
    point_range: Crop
    typical: tuple[TypicalObject, ...] = field(default=(), kw_only=True)
    ious: tuple[tuple[str, Overlaps], ...] = field(default=(), kw_only=True)
    metrics: tuple[str, ...] = field(default=(), kw_only=True)
    gpu: bool | None = field(default=None, kw_only=True, metadata={OMIT_DEFAULT: True})

    def modules(self) -> tuple[str, ...]:
        return (*super().modules(), *code_of_network(network_of(self.detector)))

    def need(self, gpu_share: float = 1.0) -> Need:
        return Need(gpu_share=0.0 if self.gpu is False else gpu_share)


@dataclass(frozen=True)
class FinetuneStage(Network[TrainedDetector]):
    """Train one detector on the clouds of one placement.

    From scratch it is trained for the classes that occur; heads that exist already stay. `seed`: of
    the training. `checkpoint`: SHA-256 of the one that is started from, if any."""

    seed: int
    checkpoint: str | None

    name = "finetune"
    order = 30
    resumable = True
    tables: ClassVar = {"curve": "curves"}

    def run(
        self,
        *inputs: TrainedDetector | CollectedClouds | GroundTruth,
        **training_run: Unpack[TrainingRun],
    ) -> TrainedDetector:
        """Train on clouds and the objects in them, from a generalist if one is among `inputs`."""
        from training.dataset import occurring_classes

        clouds, objects = clouds_and_objects(inputs)
        generalist = next((base.state_dict for base in of_type(TrainedDetector, inputs)), None)
        classes, settings = self.classes, self.training
        if settings.checkpoint is None and generalist is None:
            classes = occurring_classes(classes, clouds, objects, settings.frame_share)
        return self._train(classes, clouds, objects, generalist, training_run)

    def _train(
        self,
        classes: Sequence[str],
        clouds: Clouds,
        objects: pd.DataFrame,
        generalist: Mapping[str, Tensor] | None,
        training_run: TrainingRun,
    ) -> TrainedDetector:
        from training.finetune import TrainingContext, finetune

        network = (self.point_range, self.typical, self.checkpoint, generalist)
        context = TrainingContext(*network, **training_run)
        data = (clouds, objects, self.training)
        result = finetune(self.detector, classes, *data, self.seed, context)
        return TrainedDetector(
            state_dict=result.state_dict,
            curve=result.curve,
            classes=list(classes),
            batch_size=result.batch_size,
            batch_size_reduced=result.batch_size_reduced,
            weights=result.weights,
            earlier_seconds=result.earlier_seconds,
        )


@dataclass(frozen=True)
class PretrainStage(FinetuneStage):
    """Train one detector on the clouds of many placements, scene by scene, for all classes.

    `scenes`: how many of the inputs each scene has; each numbers its own frames."""

    scenes: tuple[int, ...]

    name = "pretrain"
    order = 40

    def run(
        self,
        *inputs: TrainedDetector | CollectedClouds | GroundTruth,
        **training_run: Unpack[TrainingRun],
    ) -> TrainedDetector:
        clouds, objects = clouds_and_objects(inputs, self.scenes)
        return self._train(self.classes, clouds, objects, None, training_run)


@dataclass(frozen=True)
class PretrainedStage(Stage[TrainedDetector]):
    """Read a checkpoint whose weights are used as they are.

    `digest`: of the file that was planned with; see `training.pretrained.read_generalist`."""

    digest: str
    path: Path = field(compare=False)

    name = "pretrained"
    order = 0

    def run(self) -> TrainedDetector:
        from training.pretrained import read_generalist

        generalist = read_generalist(self.path)
        if generalist.digest != self.digest:
            raise InputError("the checkpoint has changed since the start", place=self.path)
        origin = f"{self.path.name} sha256:{generalist.digest[:12]}"
        curve = pd.DataFrame(columns=["epoch", "metric", "value"])
        return TrainedDetector(
            generalist.state_dict, curve, generalist.classes, 1, False, origin, 0.0
        )
