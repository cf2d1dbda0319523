"""The interface of a stage to plan, schedule, workers, store and run folder.

A new stage is a file with a subclass of `Stage`, and a line in the plan."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Generic, get_type_hints

from typing_extensions import TypeVar

from lidarplace.base.registry import Registry
from lidarplace.base.roi import Roi
from lidarplace.logs.box_log import BoxLog, join_logs, of_split

R = TypeVar("R", covariant=True, default=Any)
"""Type of a stage's result."""
T = TypeVar("T")


@dataclass(frozen=True)
class Need:
    """The need of a machine: bytes of memory (0: unknown), GPUs and CPU cores."""

    memory: int = 0
    gpu_share: float = 0.0
    cpus: int = 1


class Stage(ABC, Generic[R]):
    """A computation, by all that decides its result besides the results that it starts from.

    A subclass is a frozen dataclass. A field is annotated with the key paths of the configuration
    that decide it, so that a task is labelled with the axes of the grid that make a difference to
    it; one with `compare=False` decides nothing.

    Attributes:
        name: of the stage, for people, and of its folder in a store.
        order: among tasks that can run, those of the lowest order start first: late stages, so that
            a sweep that is stopped has whole results of its first trials.
        ends_trial: whether the schedule turns to the next trial after it.
        resumable: whether it is a training, which continues after a stop; its `run` also takes
            `sweeps.stages.train.TrainingRun`.
        tables: fields of the result that are tables of the run folder, field -> name of the table.
        plugins: fields that name things which may be of plug-ins, field -> where they are.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    ends_trial: ClassVar[bool] = False
    resumable: ClassVar[bool] = False
    tables: ClassVar[Mapping[str, str]] = {}
    plugins: ClassVar[Mapping[str, Registry[Any]]] = {}

    @abstractmethod
    def run(self, *inputs: Any, **how: Any) -> R:
        """Compute the result: a dataclass, whose fields a store keeps as files.

        Fields are tables, arrays, arrays by name, weights and plain data; one with a default may be
        missing in a folder."""

    def need(self, gpu_share: float = 1.0) -> Need:
        """Return what the stage takes of a machine where a training takes `gpu_share` of a GPU."""
        return Need()

    def modules(self) -> tuple[str, ...]:
        """List dotted paths of the modules whose code computes the result, with all they import."""
        modules = [type(self).__module__]
        for field, registry in self.plugins.items():
            modules += registry.modules(getattr(self, field))
        return tuple(modules)

    @classmethod
    def result(cls) -> type[R]:
        """Return the class of the result."""
        result: type[R] = get_type_hints(cls.run)["return"]
        return result

    @classmethod
    @cache
    def config_keys(cls) -> frozenset[str]:
        """Return the key paths of the configuration that decide the fields."""
        hints = get_type_hints(cls, include_extras=True).values()
        return frozenset(key for hint in hints for key in getattr(hint, "__metadata__", ()))


class VoxelStage(Stage[R]):
    """A stage whose memory is that of the voxels of its ROI.

    `bytes_per_voxel` of its subclasses is the most, where every voxel is occupied, as
    `benchmarks/voxel_memory.py` measures it. What is mapped from files does not count."""

    roi: Any  # the subclasses annotate it as Roi, with its key paths

    @abstractmethod
    def bytes_per_voxel(self) -> int:
        """Return how many bytes a voxel takes at most."""

    def need(self, gpu_share: float = 1.0) -> Need:
        roi: Roi = self.roi
        return Need(memory=math.prod(roi.shape) * self.bytes_per_voxel())


OCCLUSION_BYTES = 9
"""Bytes that occlusion takes per voxel in addition."""


def of_type(kind: type[T], inputs: Iterable[object]) -> list[T]:
    """Select the inputs of a type."""
    return [item for item in inputs if isinstance(item, kind)]


def training_log(logs: Sequence[BoxLog]) -> BoxLog:
    """Join the parts of a scene, and keep the frames of the training split with their boxes."""
    return of_split(join_logs(logs), "train")
