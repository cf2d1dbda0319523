"""The stage that computes the surrogates of objects, such as the expected recall."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import pandas as pd

from lidarplace import Placement, Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.pog.surrogates.table import SURROGATES
from lidarplace.recall.detection_curve import DetectionCurves
from sweeps.stages.stage import Stage, training_log
from sweeps.stages.surrogates import Scores

if TYPE_CHECKING:
    from lidarplace.recall.expected_recall import ExpectedRecall


@dataclass(frozen=True)
class RecallStage(Stage[Scores]):
    """Compute the surrogates of objects, for every class of which an object counts.

    `rigs`: the rig of the clouds, with their quirks and azimuth steps; or as single vehicles have
    it, with displaced mounts: values are the mean over them. `roi`: its resolution does not matter.
    `seed`: of the shapes of the objects. `frames`: how many are used at most, spread over those of
    the training split. `vehicle`: carries the LiDARs; None: a sedan."""

    rigs: Annotated[tuple[Placement, ...], "placement", "lidar", "weather", "surrogate.mount_draws"]
    names: Annotated[tuple[str, ...], "surrogate.names"]
    roi: Annotated[Roi, "roi", "surrogate.resolution"]
    classes: Annotated[tuple[str, ...], "classes"]
    curves: Annotated[DetectionCurves, "surrogate.curves"]
    seed: Annotated[int, "scene"]
    frames: int
    vehicle: Annotated[Vehicle | None, "vehicle"] = None

    name = "recall"
    order = 100
    tables: ClassVar = {"table": "surrogates"}
    plugins: ClassVar = {"names": SURROGATES}

    def run(self, *logs: BoxLog) -> Scores:
        from lidarplace.recall.baselines import baselines
        from lidarplace.recall.counted_objects import CountedObjects

        start = time.perf_counter()
        if "expected_recall" in self.names:
            model = self.expected_recall(logs)
            values = _mean(
                model.recall(seen).join(baselines(model.objects, seen), how="inner")
                for seen in model.objects.seen_by(self.rigs)
            )
        else:  # the others need no detection curves
            log, cell = training_log(logs), self.curves.cell
            objects = CountedObjects.from_log(log, self.roi, self.classes, cell, **self._sample())
            values = _mean(baselines(objects, seen) for seen in objects.seen_by(self.rigs))
        table = values[list(self.names)].reset_index().melt("class", var_name="surrogate")
        return Scores(table.assign(method="raycast", seconds=time.perf_counter() - start))

    def expected_recall(self, logs: Sequence[BoxLog], azimuth_share: float = 1.0) -> ExpectedRecall:
        """Return the model of the objects, for which `azimuth_share` of the steps are cast."""
        from lidarplace.recall.expected_recall import ExpectedRecall

        return ExpectedRecall.from_log(
            training_log(logs),
            self.roi,
            self.classes,
            self.curves,
            azimuth_share=azimuth_share,
            **self._sample(),
        )

    def _sample(self) -> dict[str, Any]:
        return {"frames": self.frames, "seed": self.seed, "vehicle": self.vehicle}


def _mean(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    per_rig = list(tables)
    if len(per_rig) == 1:
        return per_rig[0]
    return pd.concat(per_rig).groupby(level=0, sort=False).mean()
