"""The stage that computes how surrogates depend on the choice of the frames."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import pandas as pd

from lidarplace import Placement, Roi
from lidarplace.coverage import Method
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.pog.surrogates.sampling_error import SamplingError, pog_sampling_error
from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.stages.stage import OCCLUSION_BYTES, VoxelStage, training_log


@dataclass(frozen=True)
class SamplingErrorStage(VoxelStage[SamplingError]):
    """Compute intervals of surrogates: the frames of the POG are drawn again in blocks.

    Empty for a single frame."""

    placement: Annotated[Placement, "placement", "lidar", "weather"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    detection_probability: Annotated[float, "surrogate.detection_probability"]
    occlusion: Annotated[bool, "surrogate.occlusion"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    classes: Annotated[tuple[str, ...], "classes"]
    method: Annotated[Method, "surrogate.method"]

    name = "sampling_error"
    order = 130
    tables: ClassVar = {"estimates": "sampling_error", "resamples": "pog_resamples"}
    plugins: ClassVar = {"names": SURROGATES}

    def bytes_per_voxel(self) -> int:
        return 36 + 9 * len(self.classes) + OCCLUSION_BYTES * self.occlusion

    def run(self, *logs: BoxLog) -> SamplingError:
        log = training_log(logs)
        if len(log.frames) < 2:
            return SamplingError(pd.DataFrame(), pd.DataFrame())
        q, occlusion = self.detection_probability, self.occlusion
        return pog_sampling_error(
            log,
            self.roi,
            self.classes,
            self.placement,
            self.names,
            Sensing(self.method, q, occlusion),
        )
