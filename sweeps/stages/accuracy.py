"""The stage that compares ways of computing surrogates: error against run time."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import pandas as pd

from lidarplace import Placement, Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.surrogates.error_against_time import Variation, accuracy
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.stages.stage import OCCLUSION_BYTES, VoxelStage, training_log


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Columns of `lidarplace.pog.surrogates.error_against_time.accuracy`."""

    table: pd.DataFrame


@dataclass(frozen=True)
class AccuracyStage(VoxelStage[Accuracy]):
    """Compute surrogates of one class in several ways.

    The ways are methods, and the given resolutions, azimuth steps and shares of the frames."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]
    object_class: Annotated[str, "classes"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    resolutions: tuple[float, ...]
    azimuth_steps: tuple[int, ...]
    frame_shares: tuple[float, ...]

    name = "accuracy"
    order = 120
    tables: ClassVar = {"table": "accuracy"}
    plugins: ClassVar = {"names": SURROGATES}

    def bytes_per_voxel(self) -> int:
        return 15 + OCCLUSION_BYTES * self.occlusion

    def run(self, *logs: BoxLog) -> Accuracy:
        table = accuracy(
            training_log(logs),
            self.roi,
            self.object_class,
            self.placement,
            Variation(self.resolutions, self.azimuth_steps, self.frame_shares),
            Sensing(detection_probability=self.detection_probability, occlusion=self.occlusion),
            self.names,
        )
        return Accuracy(table)
