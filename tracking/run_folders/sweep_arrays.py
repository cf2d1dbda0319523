"""Arrays of a sweep's run folder: what the report draws of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.files.arrays import check_numbers
from tracking.run_folders.array_file import ArrayFile


@dataclass(frozen=True)
class Maps(ArrayFile):
    """What lies around the vehicle and what placements cover of it, over the ROI.

    From above is by columns of voxels, shape (nx, ny); from the side, seen along y, by rows of
    voxels, shape (nx, nz). All are float32. Older run folders have no residual entropy and nothing
    from the side.

    Attributes:
        pog: by class, the entropy in nats, from above.
        coverage, coverage_side: by placement, the covered share, in [0, 1].
        residual, residual_side: by placement, the entropy of all classes that no beam covers, nats.
    """

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]]
    coverage: dict[str, NDArray[np.float32]]
    coverage_side: dict[str, NDArray[np.float32]]
    residual: dict[str, NDArray[np.float32]]
    residual_side: dict[str, NDArray[np.float32]]

    def _check(self, path: Path) -> None:
        for field, arrays in vars(self).items():
            for name, array in arrays.items():
                check_numbers(f"{field}/{name}", array, 2, path)


@dataclass(frozen=True)
class Frame(ArrayFile):
    """One frame as every placement sees it, in the ego frame.

    Attributes:
        boxes: ground truth x, y, z, length, width, height, yaw, shape (m, 7), float64.
        labels: class of every box, shape (m,), str.
        points: by placement, x, y, z in metres and intensity, shape (n, 4), float32.
        lidar: by placement, the mount that each point comes from, shape (n,), uint8.
    """

    FILE: ClassVar[str] = "frame.npz"

    boxes: NDArray[np.float64]
    labels: NDArray[np.str_]
    points: dict[str, NDArray[np.float32]]
    lidar: dict[str, NDArray[np.uint8]]

    def _check(self, path: Path) -> None:
        check_numbers("boxes", self.boxes, 2, path)
        if self.boxes.shape[1] != 7 or self.labels.shape != self.boxes.shape[:1]:
            raise ValueError(
                f"{path}: boxes need 7 numbers and a label each, found {self.boxes.shape} and "
                f"{self.labels.shape} labels"
            )
        if self.labels.dtype.kind != "U":
            raise ValueError(f"{path}: labels must hold text, found {self.labels.dtype}")
        if set(self.points) != set(self.lidar):
            raise ValueError(
                f"{path}: points of {', '.join(self.points)}, but lidar of {', '.join(self.lidar)}"
            )
        for name, points in self.points.items():
            check_numbers(f"points/{name}", points, 2, path)
            check_numbers(f"lidar/{name}", self.lidar[name], 1, path)
            if points.shape != (len(self.lidar[name]), 4):
                raise ValueError(
                    f"{path}: points/{name} needs 4 numbers for each of {len(self.lidar[name])} "
                    f"points, found shape {points.shape}"
                )


@dataclass(frozen=True)
class FailureFrames(ArrayFile):
    """Frames that tell which objects one rig found and another one missed.

    Attributes:
        rigs: the two placements, shape (2,), str.
        objects: number in `objects.parquet` of the object that each frame is shown for, shape (n,),
            int64.
        points: by place in `objects` and in `rigs`, as `0/1`, x, y, z in metres of a thinned cloud
            that has all points on objects, shape (p, 3), float32.
        detections: alike, x, y, z, length, width, height, yaw and score of the lowest seed's, shape
            (d, 8), float64.
    """

    FILE: ClassVar[str] = "failures.npz"

    rigs: NDArray[np.str_]
    objects: NDArray[np.int64]
    points: dict[str, NDArray[np.float32]]
    detections: dict[str, NDArray[np.float64]]

    def are_of(self, rigs: tuple[str, str], objects: pd.Series) -> bool:
        """Whether they show objects of these numbers under these two rigs, in this order."""
        return self.rigs.tolist() == [*rigs] and bool(np.isin(self.objects, objects).all())

    def _check(self, path: Path) -> None:
        if self.rigs.shape != (2,) or self.rigs.dtype.kind != "U":
            raise ValueError(f"{path}: rigs must hold two names, found {self.rigs!r}")
        check_numbers("objects", self.objects, 1, path)
        places = [f"{place}/{rig}" for place in range(len(self.objects)) for rig in range(2)]
        for field, width in (("points", 3), ("detections", 8)):
            own = getattr(self, field)
            for place in places:
                if place not in own:
                    raise ValueError(f"{path} has no array {field}/{place}")
                check_numbers(f"{field}/{place}", own[place], 2, path)
                if own[place].shape[1] != width:
                    raise ValueError(
                        f"{path}: {field}/{place} needs {width} columns, found shape "
                        f"{own[place].shape}"
                    )
