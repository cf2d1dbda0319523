"""What each stage returns: a frozen class per stage, which a store keeps as a folder of files.

A stage that is not named here returns a class of the package that it calls: `scene` a `BoxLog`,
`sampling_error` a `SamplingError`. Fields are tables, arrays, arrays by name, weights and plain
data; one with a default may be missing in a folder.
"""

# Annotations are read at run time, by `sweeps.store.result_folder`.

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.clouds.clouds import PointClouds

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Objects that count, ego frame, and scene, frame, route, split of all frames of a part of a
    scene."""

    objects: pd.DataFrame
    frames: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Pog:
    """Occupancy of every class. `classes`: in the order of the configuration. `frames`: T, of the
    training split. `roi`: voxels. `counts`: by class, frames in which each voxel is occupied, shape
    (nx, ny, nz), int32. `from_above`: by class, entropy summed over z, nats, shape (nx, ny),
    float32."""

    classes: Sequence[str]
    frames: int
    roi: Roi
    counts: Mapping[str, NDArray[np.int32]]
    from_above: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Scores:
    """Surrogates of one rig: class, surrogate, value, method, seconds.

    Rows of `expected_ig` have a `linear_share`, too."""

    table: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Required:
    """What becomes of each requirement under a rig. `table`: columns of
    `lidarplace.requirements.tables.case_table`. `x`, `y`, `least`: those of
    `lidarplace.requirements.tables.Ground`, metres and the measure of the requirement, by its
    number; `least` as float32."""

    table: pd.DataFrame
    x: Mapping[str, NDArray[np.float64]]
    y: Mapping[str, NDArray[np.float64]]
    least: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Columns of `lidarplace.pog.surrogates.error_against_time.accuracy`, less placement."""

    table: pd.DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Collected(PointClouds):
    """Clouds of one split of a part of a scene; of every object frame, object_id, points."""

    points_per_object: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Trained:
    """A detector: what `training.finetune.FinetuneResult` has, and the classes that it detects."""

    state_dict: "Mapping[str, Tensor]"
    curve: pd.DataFrame
    classes: Sequence[str]
    batch_size: int
    batch_size_reduced: bool
    weights: str
    earlier_seconds: float


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Detections of one split, and what they are worth; percent at each class's IoUs. `metrics`,
    `pr_curves`, `left_out`: `metrics`, `curves` and `left_out` of `training.kitti_ap.Evaluation`.
    `by_distance`: columns of `training.by_place.evaluate_by_distance`. `by_sector`: columns of
    `training.by_place.recall_by_sector`. `detections`: `boxes` of `training.detect.Detections`."""

    metrics: pd.DataFrame
    pr_curves: pd.DataFrame
    left_out: pd.DataFrame
    by_distance: pd.DataFrame
    by_sector: pd.DataFrame
    detections: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Judged:
    """`boxes` of `training.detect.Detections`, the column frame of all that were looked at, and
    what is implausible about a command's, a line each."""

    detections: pd.DataFrame
    frames: pd.DataFrame
    cautions: Sequence[str] = ()
