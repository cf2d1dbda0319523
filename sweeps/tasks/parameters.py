"""What each stage depends on, besides the results that it starts from: a frozen class per stage.

A field is annotated with the key paths of the configuration that decide it, so that a task is named
after the axes of the grid that make a difference to it.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from cachetools import cached

from lidarplace import Placement, Roi
from lidarplace.base.metrics import Overlaps
from lidarplace.base.roi import Interval
from lidarplace.clouds.clouds import Crop
from lidarplace.coverage import Method
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import DetectionCurves
from lidarplace.requirements.requirement import Requirement
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.parts import Recording
from sweeps.configuration.evaluator import EvaluatorCommand
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject


@cached({}, key=type)
def keys_of(params: Any) -> frozenset[str]:
    """Key paths of the configuration that decide the parameters of a stage, by their class."""
    hints = get_type_hints(type(params), include_extras=True).values()
    return frozenset(key for hint in hints for key in getattr(hint, "__metadata__", ()))


@dataclass(frozen=True)
class SceneParams:
    """A part of a scene that is recorded by itself."""

    recording: Annotated[Recording, "scene"]


@dataclass(frozen=True)
class GroundTruthParams:
    """Where objects count, metres in the ego frame, and the seed of their shapes."""

    x: Annotated[Interval, "roi"]
    y: Annotated[Interval, "roi"]
    z: Annotated[Interval, "roi"]
    seed: Annotated[int, "scene"]


@dataclass(frozen=True)
class PogParams:
    """Voxels, and the classes of which each has a grid."""

    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    classes: Annotated[tuple[str, ...], "classes"]


@dataclass(frozen=True)
class SurrogateParams:
    """Rig of which the surrogates of a POG are computed, and how."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    method: Annotated[Method, "surrogate.method"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]


@dataclass(frozen=True)
class RecallParams:
    """How surrogates of objects are computed. `rigs`: the rig of the clouds, with their quirks and
    azimuth steps; or as single vehicles have it, with their mounts off. Values are the mean over
    them. `roi`: its resolution does not matter. `seed`: of the shapes of the objects. `frames`: at
    most so many, spread over those of the training split. `vehicle`: carries the LiDARs; None: a
    sedan."""

    rigs: Annotated[tuple[Placement, ...], "placement", "lidar", "weather", "surrogate.mount_draws"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    classes: Annotated[tuple[str, ...], "classes"]
    curves: Annotated[DetectionCurves, "surrogate.curves"]
    seed: Annotated[int, "scene"]
    frames: int
    vehicle: Annotated[Vehicle | None, "vehicle"] = None


@dataclass(frozen=True)
class RequirementsParams:
    """What is required of the rig, and the vehicle that carries it."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    vehicle: Annotated[Vehicle, "vehicle"]
    requirements: Annotated[tuple[Requirement, ...], "surrogate.curves"]
    further: Annotated[tuple[MountedSensor, ...], "placement"] = ()


@dataclass(frozen=True)
class AccuracyParams:
    """The rig, and what is compared: see `lidarplace.pog.surrogates.error_against_time`."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]
    object_class: Annotated[str, "classes"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    resolutions: tuple[float, ...]
    azimuth_steps: tuple[int, ...]
    frame_shares: tuple[float, ...]


@dataclass(frozen=True)
class SamplingErrorParams:
    """The rig, and the surrogates whose spread is asked for."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]
    classes: Annotated[tuple[str, ...], "classes"]
    method: Annotated[Method, "surrogate.method"]
    names: Annotated[tuple[str, ...], "surrogate.names"]


@dataclass(frozen=True)
class CollectParams:
    """How the clouds of a split are simulated. `placement`: with quirks and fewer azimuth steps, if
    the collection has them. `crop`: lowest x, y, z and highest x, y, z that points are kept in,
    metres. `seed`: of shapes, drop-off, range noise and mounting errors. `errors`: of the mounts.
    `first`, `every`: which frames of the split are collected; all by default. `vehicle`: carries
    the LiDARs; None: a sedan."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    misaligned_heights: Annotated[bool, "lidar.misaligned_heights"]
    seed: Annotated[int, "scene"]
    split: str
    crop: Annotated[Crop, "roi", "placement", "lidar"]
    errors: Annotated[MountingErrors, "mounting_errors"]
    first: int = 0
    every: int = 1
    vehicle: Annotated[Vehicle | None, "vehicle"] = None


@dataclass(frozen=True)
class RecordedParams:
    """The folder of clouds of a rig that were recorded, and the hash of their content. `rig`: that
    recorded them, in whose order points are; None: that of the placement alone. `lidars`: of it,
    whose points are taken."""

    folder: Annotated[Path, "placement", "scene"]
    digest: str
    split: str
    crop: Annotated[Crop, "roi", "placement", "lidar"]
    rig: RecordedRig | None = None
    lidars: Annotated[tuple[str, ...], "placement"] = ()


@dataclass(frozen=True)
class NetworkParams:
    """A detector, what it detects, and how it is trained and selects boxes. `point_range`: the crop
    of the clouds. `typical`: objects of which anchors are, of classes that have not the preset's.
    `ious`: of classes that are judged by others than KITTI's, where detections are judged.
    `metrics`: of plug-ins, where detections are judged."""

    detector: str
    classes: tuple[str, ...]
    training: TrainingSettings
    point_range: Crop
    typical: tuple[TypicalObject, ...] = field(default=(), kw_only=True)
    ious: tuple[tuple[str, Overlaps], ...] = field(default=(), kw_only=True)
    metrics: tuple[str, ...] = field(default=(), kw_only=True)


@dataclass(frozen=True)
class JudgeParams(NetworkParams):
    """Further how the clouds of the rig are simulated, and which frames."""

    collection: CollectParams


@dataclass(frozen=True)
class TrainingParams(NetworkParams):
    """Further the seed, and the SHA-256 of the checkpoint that is started from, if any."""

    seed: int
    checkpoint: str | None


@dataclass(frozen=True)
class PretrainedParams:
    """A checkpoint whose weights are used as they are, see
    `training.pretrained.read_generalist`."""

    digest: str
    path: Path = field(compare=False)


@dataclass(frozen=True)
class PretrainParams(TrainingParams):
    """Further how many of the inputs each scene has; each numbers its own frames."""

    scenes: tuple[int, ...]


@dataclass(frozen=True)
class CommandParams:
    """A command that detects. `digests`: of the content of what it depends on. `rig`, `seed`: what
    `{rig}` and `{seed}` stand for; None: the command has them not. `log`: file that gets what it
    prints."""

    evaluator: EvaluatorCommand
    digests: tuple[str, ...]
    classes: tuple[str, ...]
    rig: str | None
    seed: int | None
    log: Path = field(compare=False)


@dataclass(frozen=True)
class MeasureParams:
    """What detections are measured by; attributes as of `NetworkParams`."""

    classes: tuple[str, ...]
    ious: tuple[tuple[str, Overlaps], ...]
    metrics: tuple[str, ...]
