"""What rays through the voxels cost, what a scene does not need, and error against run time.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/rays.py

`line_roll` of the paper, 4 LiDARs x 16 beams x 5,625 azimuth steps, in the front ROI of
40 x 40 x 4 m at 0.1 m. The POG is made up: 300 frames with a car each, anywhere in the ROI. NumPy
stands for a plain version: points every half voxel along every ray, rounded down to voxels; it
misses corners that a ray cuts. Minimum of 5 runs each, taken in turns.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace import PAPER_PLACEMENTS, OccupancyGrid, Placement, Roi
from lidarplace.coverage.rays import covered_by_rays, log_miss, ray_counts, ray_weight
from lidarplace.pog.surrogates.formulas import (
    Crossings,
    expected_ig_with_occlusion,
    expected_points,
)

ROI = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
FULL_ROI = Roi(x=(-40, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
RIG = PAPER_PLACEMENTS["line_roll"]
Q = 0.1
RUNS = 5
FRAMES = 300
STRIDES = (1, 2, 5, 10, 20, 50, 100)


def traffic(frames: int = FRAMES) -> OccupancyGrid:
    """A car a frame."""
    rng = np.random.default_rng(0)
    boxes = pd.DataFrame(
        {
            "frame": np.arange(frames),
            "class": "Car",
            "x": rng.uniform(3, 38, frames),
            "y": rng.uniform(-18, 18, frames),
            "z": 0.8,
            "length": 4.4,
            "width": 1.8,
            "height": 1.6,
            "yaw": rng.uniform(-np.pi, np.pi, frames),
        }
    )
    return OccupancyGrid.from_boxes(boxes, ROI, "Car", frames)


def numpy_counts(placement: Placement) -> NDArray[np.int64]:
    """Rays through every voxel of ROI by points along the rays."""
    counts = np.zeros(math.prod(ROI.shape), np.int64)
    diagonal = math.dist((0, 0, 0), ROI.shape) * ROI.resolution
    along = np.arange(0, diagonal, ROI.resolution / 2)
    for mount in placement.mounts:
        for ray in placement.lidar.directions() @ mount.rotation.T:
            points = mount.position + along[:, None] * ray
            cells = np.floor((points - ROI.minimum) / ROI.resolution).astype(int)
            cells = cells[((cells >= 0) & (cells < ROI.shape)).all(axis=1)]
            voxels = np.unique(np.ravel_multi_index(tuple(cells.T), ROI.shape))
            counts[voxels] += 1
    return counts.reshape(ROI.shape)


def minima(runs: dict[str, Callable[[], object]], number: int = RUNS) -> dict[str, float]:
    """Least seconds of each, after one run that compiles."""
    best = dict.fromkeys(runs, math.inf)
    for run in runs.values():
        run()
    for _ in range(number):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def show(title: str, seconds: dict[str, float]) -> None:
    first = next(iter(seconds.values()))
    print(f"\n{title}")
    for name, value in seconds.items():
        print(f"  {name:42s}{value * 1e3:9.1f} ms  x {value / first:.2f}")


def main() -> None:
    grid = traffic()
    rays = len(RIG.mounts) * RIG.lidar.rays
    counts = ray_counts(RIG, ROI, "dda")
    print(f"{rays:,} rays, {int(counts.sum()):,} voxels passed, one core, minimum of {RUNS} runs")
    print(f"occupied voxels {np.mean(grid.counts > 0):.1%}")

    show(
        "Four LiDARs",
        minima(
            {
                "dda coverage": lambda: covered_by_rays(RIG, ROI, "dda"),
                "dda counts": lambda: ray_counts(RIG, ROI, "dda"),
                "dda log_miss with occlusion": lambda: log_miss(
                    RIG, ROI, "dda", grid.counts, FRAMES, Q
                ),
                "bresenham coverage": lambda: covered_by_rays(RIG, ROI, "bresenham"),
                "bresenham counts": lambda: ray_counts(RIG, ROI, "bresenham"),
            }
        ),
    )

    one = Placement("one", RIG.mounts[:1], lidar=RIG.lidar)
    few = replace(RIG.lidar, elevations=RIG.lidar.elevations[:1])
    beam = Placement("beam", RIG.mounts[:1], lidar=few)
    title = "One beam of one LiDAR; NumPy once"
    seconds = minima({"dda counts": lambda: ray_counts(beam, ROI, "dda")})
    start = time.perf_counter()
    plain = numpy_counts(beam)
    seconds["NumPy"] = time.perf_counter() - start
    show(title, seconds)
    exact = ray_counts(beam, ROI, "dda")
    print(
        f"  voxels that NumPy misses: {np.mean(plain[exact > 0] == 0):.2%}, of the rays' visits "
        f"{1 - plain.sum() / exact.sum():.2%}"
    )

    def with_lidar(**changes: object) -> Placement:
        return one.with_lidar(replace(one.lidar, **changes))  # type: ignore[arg-type]

    rigs = {
        "range 20 m": with_lidar(range=20.0),
        "field of view 120 degrees": with_lidar(azimuth=(-math.pi / 3, math.pi / 3)),
        "field of view 120 degrees, backwards": with_lidar(
            azimuth=(2 * math.pi / 3, 4 * math.pi / 3)
        ),
        "every tenth azimuth step": with_lidar(azimuth_steps=562),
    }
    work: dict[str, Callable[[], object]] = {
        "front half, whole turn": lambda: ray_counts(one, ROI, "dda"),
        "front and rear half": lambda: ray_counts(one, FULL_ROI, "dda"),
    }
    for name, rig in rigs.items():
        work[name] = partial(ray_counts, rig, ROI, "dda")
    show("What a scene does not need: counts of one LiDAR", minima(work))

    def ig(stride: int) -> float:
        log_misses = log_miss(RIG, ROI, "dda", grid.counts, FRAMES, Q, azimuth_stride=stride)
        return expected_ig_with_occlusion(grid, log_misses)

    def points(stride: int) -> float:
        traced = ray_counts(RIG, ROI, "dda", azimuth_stride=stride)
        crossings = Crossings.of_grid(grid, traced)
        return expected_points(grid.frames, crossings, ray_weight(RIG, stride))

    print("\nError of the strides, relative to stride 1")
    print("  stride   expected_points               expected_ig with occlusion")
    times = {
        "points": minima({str(s): partial(points, s) for s in STRIDES}, 3),
        "ig": minima({str(s): partial(ig, s) for s in STRIDES}, 3),
    }
    reference = points(1), ig(1)
    for s in STRIDES:
        errors = points(s) / reference[0] - 1, ig(s) / reference[1] - 1
        print(
            f"  {s:6d}   {errors[0]:+.1e}  {times['points'][str(s)] * 1e3:7.1f} ms"
            f"         {errors[1]:+.1e}  {times['ig'][str(s)] * 1e3:7.1f} ms"
        )


if __name__ == "__main__":
    main()
