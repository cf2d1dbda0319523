"""The probabilistic occupancy grid (POG): how often an object of a class fills each voxel."""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import counts_of, listed
from lidarplace.base.errors import InputError
from lidarplace.base.plotting import Plottable
from lidarplace.base.roi import Roi
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.boxes import CLASSES, GEOMETRY, check_boxes, frame_ids
from lidarplace.logs.plausibility import implausible_boxes
from lidarplace.pog.occupancy.box_counts import count_boxes
from lidarplace.pog.occupancy.entropy import entropy_of_counts
from lidarplace.pog.occupancy.levels import Levels


@dataclass(frozen=True)
class OccupancyGrid(Plottable):
    """Occupancy of the voxels of an ROI by one class of objects.

    Attributes:
        roi: the voxels.
        object_class: class of the objects counted.
        counts: number of frames in which a voxel's centre lies in a box, shape (nx, ny, nz), int32.
        frames: number of frames looked at, T; frames without a box count."""

    roi: Roi
    object_class: str
    counts: NDArray[np.int32]
    frames: int

    def __repr__(self) -> str:
        voxels = " × ".join(map(str, self.roi.shape))
        return (
            f"OccupancyGrid({self.object_class!r}: {voxels} voxels of {self.roi.resolution:g} m, "
            f"{np.count_nonzero(self.counts):,} of them occupied in some of {self.frames:,} frames)"
        )

    def _repr_html_(self) -> str:
        rows = {
            "class": self.object_class,
            "voxels": " × ".join(map(str, self.roi.shape)),
            "edge, m": f"{self.roi.resolution:g}",
            "frames": f"{self.frames:,}",
            "occupied voxels": f"{np.count_nonzero(self.counts):,}",
            "highest p": f"{self.counts.max() / self.frames:.3g}",
            "entropy, nats": f"{self.h_pog:,.6g}",
        }
        return pd.Series(rows, dtype=str).to_frame().to_html(header=False)

    @classmethod
    def from_boxes(
        cls, boxes: pd.DataFrame, roi: Roi, object_class: str, frames: int
    ) -> OccupancyGrid:
        """Count the boxes of `object_class` in a box log (paper, equation of p-hat).

        A voxel is occupied when its centre lies in a box or on its surface. A frame counts once,
        however many boxes overlap in it. Boxes are cut at the ROI. `frames` is T, the number of
        frames that the log covers; of its columns `frame`, `class`, the box geometry and `scene`,
        if it is there, are used. Warns of boxes that look as if they were in degrees or
        millimetres. Raises ValueError: a column is missing, a value is not finite, the boxes come
        from more than `frames` frames, or nothing knows the class."""
        grids = cls.by_class(boxes, roi, (object_class,), frames)
        for problem in implausible_boxes(boxes):
            warnings.warn(problem, stacklevel=2)
        return grids[object_class]

    @classmethod
    def by_class(
        cls, boxes: pd.DataFrame, roi: Roi, classes: Collection[str], frames: int
    ) -> dict[str, OccupancyGrid]:
        """Return `from_boxes` for several classes, without its warnings.

        Frame numbers are made once.

        Raises ValueError as `from_boxes`; all `classes` together must not have more than
        `frames`."""
        _check_frames(frames)
        if not isinstance(roi, Roi):
            raise InputError(key="roi", expected="a Roi", found=repr(roi))
        if isinstance(classes, str):
            several = f"a list, such as [{classes!r}]"
            raise InputError(key="classes", expected=several, found=repr(classes))
        check_boxes(boxes)
        for name in classes:
            _check_class(name, boxes)
        of_class = {name: np.flatnonzero(boxes["class"].isin([name])) for name in classes}
        rows = np.concatenate([np.empty(0, np.int64), *of_class.values()])
        frame = frame_ids(boxes)
        filled = np.count_nonzero(np.bincount(frame[rows]))
        if filled > frames:
            names = ", ".join(repr(name) for name in of_class)
            least = f"at least {filled}, those with boxes of class {names}"
            raise InputError(key="frames", expected=least, found=frames)
        geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)
        grids = {}
        for name, rows in of_class.items():
            rows = rows[np.argsort(frame[rows], kind="stable")]
            grids[name] = cls(roi, name, count_boxes(geometry[rows], frame[rows], roi), frames)
        return grids

    @classmethod
    def merged(cls, parts: Iterable[OccupancyGrid]) -> OccupancyGrid:
        """Return the grid of all frames, from grids of disjoint sets of whole frames.

        Raises ValueError if there are no parts, they differ in ROI or class, or their frames add up
        to 2**31 or more."""
        parts = iter(parts)
        first = next(parts, None)
        if first is None:
            raise InputError(key="parts", expected="at least one grid", found="none")
        counts, frames = first.counts.copy(), first.frames
        for part in parts:
            for name in ("roi", "object_class"):
                one, other = getattr(first, name), getattr(part, name)
                if other != one:
                    raise InputError(key=f"parts: {name}", expected=repr(one), found=repr(other))
            frames += part.frames
            _check_frames(frames)
            counts += part.counts
        return cls(first.roi, first.object_class, counts, frames)

    @cached_property
    def probability(self) -> NDArray[np.float64]:
        """Probability p of every voxel, shape (nx, ny, nz)."""
        return self.counts / self.frames

    @cached_property
    def entropy(self) -> NDArray[np.float64]:
        """H of every voxel in nats, shape (nx, ny, nz)."""
        return self.entropy_of_count[self.counts]

    @cached_property
    def entropy_of_count(self) -> NDArray[np.float64]:
        """H in nats of a voxel that is occupied in 0, 1, ... frames, shape (max count + 1,)."""
        return entropy_of_counts(np.arange(int(self.counts.max()) + 1), self.frames)

    @cached_property
    def levels(self) -> Levels:
        """The occupied voxels by column and count."""
        return Levels.of_counts(self.counts)

    @cached_property
    def h_pog(self) -> float:
        """Entropy of the POG in nats, the sum of H over the ROI."""
        # Integers are exact and few terms remain: the sum has no error to speak of.
        return math.fsum(self.levels.total * self.entropy_of_level)

    def prepare(self) -> None:
        """Compute levels and entropy, which all placements share and which stay with the grid."""
        _ = self.h_pog

    @cached_property
    def entropy_of_level(self) -> NDArray[np.float64]:
        """H in nats of a voxel of every level, shape (levels,)."""
        return entropy_of_counts(self.levels.counts, self.frames)


def _check_class(name: str, boxes: pd.DataFrame) -> None:
    """Raise ValueError for a class that is neither known nor in the boxes: it is mistyped."""
    if not isinstance(name, str):
        raise InputError(key="object_class", expected="the name of a class", found=repr(name))
    counts = counts_of(boxes["class"])
    if name not in CLASSES and name not in counts:
        suggestion = f"{name!r}{did_you_mean(name, {*counts, *CLASSES})}"
        expected = f"a class of the boxes, {listed(counts)}"
        raise InputError(key="object_class", expected=expected, found=suggestion)


def _check_frames(frames: int) -> None:
    if not isinstance(frames, Integral):
        raise InputError(key="frames", expected="a whole number", found=repr(frames))
    if not 1 <= frames < 2**31:  # counts are int32
        raise InputError(key="frames", expected="1 to 2**31 - 1", found=frames)
