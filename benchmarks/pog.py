"""Boxes per second of counting a probabilistic occupancy grid, beside plain NumPy.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/pog.py

Counts car-sized boxes of any yaw, centres uniform in the ROI, three classes, at 0.1 m. Ours is
`OccupancyGrid.by_class` from a DataFrame, with all its checks and sorting, for 100,000 boxes. The
NumPy version is what one would write without a kernel: per box a mask over the voxels around it,
and a stamp per voxel so that a frame counts once. It gets the first 5,000 boxes only, and both
must count the same there. Minimum of 5 runs each, taken in turns.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace import OccupancyGrid, Roi
from lidarplace.logs.boxes import CLASSES, GEOMETRY

ROI = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
BOXES = 100_000
BOXES_FOR_NUMPY = 5_000
BOXES_PER_FRAME = 10
RUNS = 5


def box_log(rng: np.random.Generator, boxes: int, per_frame: int = BOXES_PER_FRAME) -> pd.DataFrame:
    """Boxes of 4.5 x 1.8 x 1.5 m."""
    return pd.DataFrame(
        {
            "scene": "made up",
            "frame": np.arange(boxes) // per_frame,
            "class": rng.choice(CLASSES, boxes),
            "x": rng.uniform(*ROI.x, boxes),
            "y": rng.uniform(*ROI.y, boxes),
            "z": rng.uniform(0.7, 0.9, boxes),
            "length": 4.5,
            "width": 1.8,
            "height": 1.5,
            "yaw": rng.uniform(-math.pi, math.pi, boxes),
        }
    )


def with_numpy(boxes: pd.DataFrame, object_class: str) -> NDArray[np.int32]:
    """Counts of one class, shape (nx, ny, nz)."""
    counts = np.zeros(ROI.shape, np.int32)
    last = np.full(ROI.shape, -1, np.int32)  # frame that counted a voxel last
    xs, ys, zs = (ROI.centres(axis) for axis in range(3))
    rows = boxes[boxes["class"] == object_class].sort_values("frame")
    for frame, box in zip(
        rows["frame"].to_numpy(), rows[list(GEOMETRY)].to_numpy(np.float64), strict=True
    ):
        x, y, z, length, width, height, yaw = box
        reach = math.hypot(length, width) / 2
        part = tuple(
            slice(*np.searchsorted(centres, (centre - half - 1e-6, centre + half + 1e-6)))
            for centres, centre, half in ((xs, x, reach), (ys, y, reach), (zs, z, height / 2))
        )
        dx, dy = xs[part[0], None, None] - x, ys[None, part[1], None] - y
        c, s = math.cos(yaw), math.sin(yaw)
        new = (
            (np.abs(c * dx + s * dy) <= length / 2)
            & (np.abs(c * dy - s * dx) <= width / 2)
            & (np.abs(zs[part[2]] - z) <= height / 2)
            & (last[part] != frame)
        )
        counts[part] += new
        last[part][new] = frame
    return counts


def main() -> None:
    rng = np.random.default_rng(0)
    boxes = box_log(rng, BOXES)
    one_class = boxes.assign(**{"class": "Car"})
    crowded = box_log(rng, BOXES, per_frame=100)
    outside = boxes.assign(x=boxes["x"] + 100.0)
    few = boxes.head(BOXES_FOR_NUMPY)
    for name, grid in OccupancyGrid.by_class(few, ROI, CLASSES, BOXES).items():
        if not np.array_equal(grid.counts, with_numpy(few, name)):
            raise SystemExit(f"lidarplace and NumPy count {name} differently")

    def ours(log: pd.DataFrame, *classes: str) -> Callable[[], object]:
        return lambda: OccupancyGrid.by_class(log, ROI, classes, BOXES)

    numpy_name = "NumPy, three classes"
    runs: dict[str, tuple[Callable[[], object], int]] = {
        "lidarplace, three classes": (ours(boxes, *CLASSES), BOXES),
        "lidarplace, one class": (ours(one_class, "Car"), BOXES),
        "lidarplace, 100 boxes a frame": (ours(crowded, *CLASSES), BOXES),
        "lidarplace, all outside the ROI": (ours(outside, *CLASSES), BOXES),
        "lidarplace, a class that never occurs": (ours(one_class, "Cyclist"), BOXES),
        numpy_name: (lambda: [with_numpy(few, c) for c in CLASSES], BOXES_FOR_NUMPY),
    }
    best = dict.fromkeys(runs, math.inf)
    for _ in range(RUNS):
        for name, (run, _) in runs.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    print(f"{BOXES_PER_FRAME} boxes a frame, ROI of {ROI.shape} voxels, one core, best of {RUNS}")
    print(f"lidarplace and NumPy count the same in {BOXES_FOR_NUMPY:,} boxes of three classes")
    rate = {name: number / best[name] for name, (_, number) in runs.items()}
    for name, (_, number) in runs.items():
        print(f"{name:40s}{number:9,} boxes {best[name]:8.3f} s {rate[name]:12,.0f} boxes/s")
    print(f"lidarplace / NumPy: {rate['lidarplace, three classes'] / rate[numpy_name]:.0f}")


if __name__ == "__main__":
    main()
