"""`expected_recall`: the mean probability that an object is found, from boxes alone.

`1/n sum over objects b of p(cells of b that the rig hits)`, p a detection curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.ranges import LIDAR_HEIGHT
from lidarplace.base.roi import Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.detection_curve import IOU, DetectionCurves, default_curves
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.rigs.placement import Placement

COLUMNS = ("expected_recall", "standard_error", "objects", "individuals")


@dataclass(frozen=True, eq=False)
class ExpectedRecall:
    """The surrogate over the objects of a log that count; `from_log` makes it.

    Attributes:
        objects: the objects.
        classes: classes that are asked for, also those of which there is no object.
        most, rate: of the detection curve of every object, float64, shape (objects,)."""

    objects: CountedObjects
    classes: tuple[str, ...]
    most: NDArray[np.float64]
    rate: NDArray[np.float64]

    @classmethod
    def from_log(
        cls,
        log: BoxLog,
        roi: Roi,
        classes: Sequence[str],
        curves: DetectionCurves | None = None,
        *,
        iou: float = IOU,
        frames: int | None = None,
        azimuth_share: float = 1.0,
        seed: int = 0,
        vehicle: Vehicle | None = None,
    ) -> ExpectedRecall:
        """Find the objects that count and their curves; casts no ray yet.

        `curves` are detection curves, those of the package by default; `iou` is the overlap that a
        detection must exceed: there is a curve for it and each class. The other arguments are those
        of `CountedObjects.from_log`. Some of the frames will do, as an object in neighbouring ones
        carries little information."""
        curves = default_curves() if curves is None else curves
        of_class = {name: curves.of(name, iou) for name in classes}
        subject = log, roi, classes, curves.cell
        objects = CountedObjects.from_log(
            *subject, frames=frames, azimuth_share=azimuth_share, seed=seed, vehicle=vehicle
        )
        curve_of_object = [of_class[name] for name in objects.table["class"]]
        most, rate = (
            np.array([getattr(c, n) for c in curve_of_object], float) for n in ("most", "rate")
        )
        return cls(objects, tuple(classes), most, rate)

    def of(self, placement: Placement) -> pd.DataFrame:
        """Return `recall` of one placement, from its rays.

        Raises ValueError if a LiDAR is under the ground, or as `CountedObjects.seen_by`."""
        for number, mount in enumerate(placement.mounts, start=1):
            LIDAR_HEIGHT.check("z", mount.z, place=f"{placement.name!r}: LiDAR {number}")
        return self.recall(self.objects.seen_by([placement])[0])

    def probabilities(self, seen: SurfaceCells) -> NDArray[np.float64]:
        """Return the probability that each object is found, shape (objects,)."""
        return self.found(seen.counts())

    def found(self, cells: NDArray[np.int64] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probability that each object is found by its distinct cells, (objects,)."""
        return self.most * -np.expm1(-self.rate * cells)

    def recall(self, seen: SurfaceCells) -> pd.DataFrame:
        """Return the surrogate, a row a class: columns `COLUMNS`, index `class`.

        `standard_error` is that of the objects that happened to be there, with individuals (scene
        and `object_id`) as clusters. It is alike for all rigs; their differences err less. NaN: of
        a class without objects, and the error of a single individual."""
        table = self.objects.table[["scene", "object_id", "class"]].assign(
            p=self.probabilities(seen)
        )
        rows = {name: _estimate(table[table["class"] == name]) for name in self.classes}
        recalls = pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS))
        return recalls.rename_axis("class")


def _estimate(table: pd.DataFrame) -> tuple[float, float, int, int]:
    """Return the mean of `p`, its error with individuals as clusters, and both numbers."""
    number = len(table)
    if not number:
        return np.nan, np.nan, 0, 0
    mean = table["p"].mean()
    off = (table["p"] - mean).groupby([table["scene"], table["object_id"]]).sum()
    clusters = len(off)
    spread = np.nan
    if clusters > 1:
        spread = float(np.sqrt(clusters / (clusters - 1) * (off**2).sum()) / number)
    return float(mean), spread, number, clusters
