"""Greedy choice and upper bound over a grid of candidate mounts: seconds, memory and gap.

    OMP_NUM_THREADS=1 python benchmarks/selection.py

Four LiDARs of the paper's model out of 945 mounts on a roof (5 x 7 x 3 positions, 3 rolls,
3 pitches), in the front ROI of 40 x 40 x 4 m. The POGs are made up: 300 frames with a car and a
cyclist each, anywhere in the ROI, which is hard for a bound: all directions are worth the same.
"""

from __future__ import annotations

import argparse
import itertools
import time

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, OccupancyGrid, Placement, Roi
from lidarplace.pog.selection import Exposure, Limits, VoxelChoice
from lidarplace.pog.selection.tracing import Objective

SIZES = {"Car": (4.4, 1.8, 1.6), "Cyclist": (1.8, 0.7, 1.8)}
WEIGHTS = {"Car": 1.0, "Cyclist": 2.0}
STRIDES: dict[Objective, int] = {"covered_entropy": 1, "expected_ig": 8}
FRAMES = 300
LIDARS = 4


def traffic(resolution: float) -> dict[str, OccupancyGrid]:
    """A car and a cyclist a frame."""
    rng = np.random.default_rng(0)
    parts = [
        pd.DataFrame(
            {
                "frame": np.arange(FRAMES),
                "class": name,
                "x": rng.uniform(3, 38, FRAMES),
                "y": rng.uniform(-18, 18, FRAMES),
                "z": height / 2,
                "length": length,
                "width": width,
                "height": height,
                "yaw": rng.uniform(-np.pi, np.pi, FRAMES),
            }
        )
        for name, (length, width, height) in SIZES.items()
    ]
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=resolution)
    return OccupancyGrid.by_class(pd.concat(parts), roi, tuple(SIZES), FRAMES)


def candidates() -> list[Placement]:
    """Single mounts."""
    axes = {
        "x": np.linspace(-1, 1, 5),
        "y": np.linspace(-0.7, 0.7, 7),
        "z": np.linspace(1.6, 2.2, 3),
        "roll": np.linspace(-0.3, 0.3, 3),
        "pitch": np.linspace(-0.2, 0.2, 3),
    }
    poses = itertools.product(*(axis.tolist() for axis in axes.values()))
    mounts = [Mount(**dict(zip(axes, pose, strict=True))) for pose in poses]
    return [Placement(f"candidate {n}", [mount], Lidar.paper()) for n, mount in enumerate(mounts)]


def apart(mounts: list[Placement], metres: float) -> np.ndarray:
    """Pairs that are at least so far apart, shape (candidates, candidates)."""
    positions = np.array([placement.mounts[0].position for placement in mounts])
    distances = np.linalg.norm(positions[:, None] - positions[None], axis=-1)
    return distances >= metres


def measure(resolution: float, surrogate: Objective, seconds: float) -> None:
    grids, mounts = traffic(resolution), candidates()
    options = {"surrogate": surrogate, "azimuth_stride": STRIDES[surrogate]}
    few = Limits.at_most(2, 9)  # compiles
    compiled = Exposure.of_candidates(grids, WEIGHTS, mounts[:9], **options)  # type: ignore[arg-type]
    nine = VoxelChoice(compiled)
    nine.upper_bound(few, nine.greedy(few).chosen, seconds=1.0)
    rigs = list(PAPER_PLACEMENTS.values())
    paper = Exposure.of_candidates(grids, WEIGHTS, rigs, **options)  # type: ignore[arg-type]

    start = time.perf_counter()
    exposure = Exposure.of_candidates(grids, WEIGHTS, mounts, **options)  # type: ignore[arg-type]
    built = time.perf_counter() - start
    ones = exposure.amounts.strides == (0,)
    memory = exposure.voxels.nbytes + (0 if ones else exposure.amounts.nbytes)
    print(f"\n{surrogate} at {resolution} m, azimuth stride {STRIDES[surrogate]}")
    print(
        f"  exposures: {built:.1f} s, {memory / 1e6:.0f} MB, {len(mounts)} candidates, "
        f"{len(exposure.gain.profile):,} voxels, {len(exposure.voxels):,} entries"
    )
    limits = Limits(
        np.ones((1, len(mounts))), np.array([float(LIDARS)]), compatible=apart(mounts, 0.2)
    )
    choice = VoxelChoice(exposure)
    start = time.perf_counter()
    found = choice.greedy(limits)
    taken = time.perf_counter() - start
    plain = sum(len(mounts) - n for n in range(LIDARS))
    print(
        f"  greedy: {taken:.2f} s, {found.evaluations} marginal gains instead of {plain}, "
        f"value {found.value:.2f}, best of the paper's eight "
        f"{max(paper.value([e]) for e in range(len(rigs))):.2f}"
    )
    bound = choice.upper_bound(limits, found.chosen, seconds=seconds)
    print(f"  bound by gains: {100 * (bound.by_gains / found.value - 1):.2f} % above greedy")
    history = bound.history.assign(gap=100 * (bound.history["bound"] / found.value - 1))
    print("  seconds  gap %")
    for at in (1, 2, 5, 10, 20, 30, 60, 120, 300):
        known = history[history["seconds"] <= at]
        if len(known) and at <= 2 * seconds:
            print(f"  {at:7d}  {known['gap'].iloc[-1]:5.2f}  ({known['kind'].iloc[-1]})")
    print(f"  {history['seconds'].iloc[-1]:7.1f}  {history['gap'].iloc[-1]:5.2f}  the last")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resolutions", type=float, nargs="+", default=[0.2, 0.1])
    parser.add_argument("--seconds", type=float, default=60.0, help="for each bound")
    arguments = parser.parse_args()
    for resolution, surrogate in itertools.product(arguments.resolutions, STRIDES):
        measure(resolution, surrogate, arguments.seconds)


if __name__ == "__main__":
    main()
