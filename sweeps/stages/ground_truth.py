"""The stage that finds the objects that count."""

from dataclasses import dataclass
from typing import Annotated

import pandas as pd

from lidarplace.base.roi import Interval
from lidarplace.logs.box_log import BoxLog
from sweeps.stages.stage import Stage


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Objects that count, and all frames, of a part of a scene.

    `objects`: in the ego frame. `frames`: scene, frame, route, split."""

    objects: pd.DataFrame
    frames: pd.DataFrame


@dataclass(frozen=True)
class GroundTruthStage(Stage[GroundTruth]):
    """Find the objects of every frame that count, the same for every placement.

    `x`, `y`, `z`: where they count, metres in the ego frame. `seed`: of their shapes."""

    x: Annotated[Interval, "roi"]
    y: Annotated[Interval, "roi"]
    z: Annotated[Interval, "roi"]
    seed: Annotated[int, "scene"]

    name = "ground_truth"
    order = 60

    def run(self, log: BoxLog) -> GroundTruth:
        from lidarplace.clouds.visibility import ground_truth

        objects = ground_truth(log, self.x, self.y, self.z, seed=self.seed)
        return GroundTruth(objects, log.frames[["scene", "frame", "route", "split"]])
