"""S-MIG of a placement: exact cones beside rays and NumPy, and what a scene does not need.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/s_mig.py
    python benchmarks/s_mig.py --batch          # many placements, on one core and on all

The POG is given: made-up traffic, 1,200 frames with six cars each along two crossing roads, and
pedestrians beside them. All timings are minima of several runs taken in turns; the cache of single
sensors is cleared before each, save where it is what is measured. NumPy stands for a plain version:
points every half voxel along every ray, rounded down to voxels.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numba
import numpy as np
import pandas as pd

from lidarplace import (
    PAPER_PLACEMENTS,
    Lidar,
    Mount,
    OccupancyGrid,
    Placement,
    Roi,
    evaluate,
    evaluate_classes,
    evaluate_many,
)
from lidarplace.coverage.cone import sensor_bits

ROI = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
FULL_ROI = replace(ROI, x=(-40, 40))
FINE_FULL_ROI = replace(FULL_ROI, resolution=0.05)
FRAMES = 1200
TILTED = Placement(
    "all tilted",
    [replace(m, roll=m.roll + 0.15, pitch=0.1) for m in PAPER_PLACEMENTS["pyramid"].mounts],
    lidar=Lidar.paper(),
)
SIDEWAYS = Placement(
    "on their sides",
    [replace(m, roll=math.pi / 2 - 0.2 * i) for i, m in enumerate(PAPER_PLACEMENTS["line"].mounts)],
    lidar=Lidar.paper(),
)


def traffic(width: float = 8.0) -> pd.DataFrame:
    """Cars on two crossing roads of that width, and pedestrians beside them."""
    rng = np.random.default_rng(0)
    n = 6 * FRAMES
    along, across = rng.uniform(-42, 42, n), rng.uniform(-width / 2, width / 2, n)
    crossing = rng.random(n) < 0.5
    yaw = np.where(crossing, np.pi / 2, 0.0) + rng.normal(0, 0.1, n)
    cars = pd.DataFrame(
        {
            "frame": np.arange(n) // 6,
            "class": "Car",
            "x": np.where(crossing, 20 + across, along),
            "y": np.where(crossing, along / 2, across),
            "z": 0.8,
            "length": rng.uniform(3.8, 5.0, n),
            "width": rng.uniform(1.65, 2.0, n),
            "height": 1.6,
            "yaw": yaw,
        }
    )
    walkers = cars.assign(length=0.6, width=0.6, height=1.75, z=0.875)
    walkers["class"] = "Pedestrian"
    walkers["y"] = np.where(crossing, walkers["y"], np.sign(across) * (width / 2 + 1))
    return pd.concat([cars, walkers], ignore_index=True)


def grid(boxes: pd.DataFrame, roi: Roi = ROI, object_class: str = "Car") -> OccupancyGrid:
    """The POG, with what depends on it alone."""
    pog = OccupancyGrid.from_boxes(boxes, roi, object_class, FRAMES)
    pog.levels, pog.h_pog  # noqa: B018 - made on first use
    return pog


def numpy_s_mig(pog: OccupancyGrid, placement: Placement) -> float:
    """Points along all rays, beam by beam."""
    roi = pog.roi
    covered = np.zeros(roi.shape, bool)
    diagonal = math.dist((0, 0, 0), roi.shape) * roi.resolution
    along = np.arange(0, diagonal, roi.resolution / 2)
    for mount in placement.mounts:
        for elevation in placement.lidar.elevations:
            beam = replace(placement.lidar, elevations=(elevation,))
            directions = beam.directions() @ mount.rotation.T
            for rays in np.array_split(directions, 16):
                points = mount.position + along[:, None] * rays[:, None, :]
                cells = np.floor((points - roi.minimum) / roi.resolution).astype(int)
                cells = cells[((cells >= 0) & (cells < roi.shape)).all(axis=-1)]
                covered[tuple(cells.T)] = True
    return -float(pog.entropy[covered].sum())


def minima(runs: Mapping[str, Callable[[], object]], number: int) -> dict[str, float]:
    """Least seconds of each, after one run that compiles."""
    best = dict.fromkeys(runs, math.inf)
    for n in range(number + 1):
        for name, run in runs.items():
            sensor_bits.cache.clear()
            start = time.perf_counter()
            run()
            seconds = time.perf_counter() - start
            best[name] = min(best[name], seconds if n else math.inf)
    return best


def methods(pog: OccupancyGrid) -> None:
    """Exact cones beside rays, on the same POG in the same run."""
    print(f"given the POG of {pog.object_class}, front ROI, 0.1 m, 4 LiDARs x 16 beams")
    print("  dda and NumPy: 5,625 azimuth steps; error of S-MIG against cone")
    for placement in (PAPER_PLACEMENTS["line"], PAPER_PLACEMENTS["line_roll"], TILTED, SIDEWAYS):
        best = minima(
            {
                "cone": partial(evaluate, pog, placement),
                "covered voxels too": lambda p=placement: evaluate(pog, p).covered_voxels,
                "dda": partial(evaluate, pog, placement, method="dda"),
            },
            7,
        )
        exact = evaluate(pog, placement).s_mig
        sampled = evaluate(pog, placement, method="dda").s_mig
        cone, dda = best["cone"], best["dda"]
        print(
            f"  {placement.name:14} cone {1e3 * cone:6.1f} ms"
            f" (with the count of all covered voxels {1e3 * best['covered voxels too']:5.1f} ms)"
            f"   dda {1e3 * dda:6.1f} ms = {dda / cone:4.1f} x, error {1 - sampled / exact:.1e}"
        )
    placement = PAPER_PLACEMENTS["line_roll"]
    start = time.perf_counter()
    peer = numpy_s_mig(pog, placement)
    seconds = time.perf_counter() - start
    cone = minima({"cone": partial(evaluate, pog, placement)}, 5)["cone"]
    error = 1 - peer / evaluate(pog, placement).s_mig
    print(
        f"  {placement.name:14} NumPy {seconds:.1f} s = {seconds / cone:,.0f} x, error {error:.1e}"
    )


def needed(boxes: pd.DataFrame, pog: OccupancyGrid) -> None:
    """Time falls with what matters to the scene."""
    placement = TILTED
    runs: dict[str, Callable[[], object]] = {"all of it": partial(evaluate, pog, placement)}
    shares = {"all of it": pog.counts.any(axis=2).mean()}
    for width in (24.0, 4.0):
        part = grid(boxes[boxes["y"].abs() < width / 2])
        name = f"cars within {width / 2:g} m of the axis"
        runs[name] = partial(evaluate, part, placement)
        shares[name] = part.counts.any(axis=2).mean()
    few = replace(placement, lidar=replace(Lidar.paper(), elevations=Lidar.paper().elevations[:8]))
    runs["8 of 16 beams"] = partial(evaluate, pog, few)
    short = replace(placement, lidar=replace(Lidar.paper(), range=15.0))
    runs["range 15 m"] = partial(evaluate, pog, short)
    ahead = replace(placement, lidar=replace(Lidar.paper(), azimuth=(-0.7, 0.7)))
    runs["field of view 80 degrees"] = partial(evaluate, pog, ahead)
    full = grid(boxes, FULL_ROI)
    whole = "full ROI instead of its front"
    runs[whole] = partial(evaluate, full, placement)
    seen = {"full ROI, field of view 80 degrees": ahead, "full ROI, range 15 m": short}
    runs |= {name: partial(evaluate, full, rig) for name, rig in seen.items()}
    walkers = grid(boxes, ROI, "Pedestrian")
    both = {"Car": pog, "Pedestrian": walkers}
    runs["pedestrians only"] = partial(evaluate, walkers, placement)
    runs["cars and pedestrians"] = partial(evaluate_classes, both, placement)
    best = minima(runs, 9)
    print("what a scene does not need, all four LiDARs tilted")
    for name, seconds in best.items():
        share = f", {shares[name]:4.0%} of columns have entropy" if name in shares else ""
        against = whole if name in seen else "all of it"
        ratio = f"{seconds / best[against]:.2f} x {against}"
        print(f"  {name:34} {1e3 * seconds:6.1f} ms = {ratio}{share}")


def one_mount(pog: OccupancyGrid) -> None:
    """A search moves one LiDAR; the other three are in the cache."""
    seconds = {}
    for moved in (4, 1):
        times = []
        evaluate(pog, TILTED)
        for n in range(20):
            mounts = [
                replace(m, z=m.z + 1e-3 * (n + 1)) if i < moved else m
                for i, m in enumerate(TILTED.mounts)
            ]
            start = time.perf_counter()
            evaluate(pog, replace(TILTED, mounts=mounts))
            times.append(time.perf_counter() - start)
        seconds[moved] = min(times)
    ratio = seconds[1] / seconds[4]
    print("placements that differ from the last one, all four LiDARs tilted")
    print(f"  in four mounts {1e3 * seconds[4]:6.1f} ms")
    print(f"  in one mount   {1e3 * seconds[1]:6.1f} ms = {ratio:.2f} x")


def fine(boxes: pd.DataFrame) -> None:
    """The full ROI at 0.05 m."""
    start = time.perf_counter()
    pog = grid(boxes, FINE_FULL_ROI)
    made = time.perf_counter() - start
    best = minima(
        {p.name: partial(evaluate, pog, p) for p in (PAPER_PLACEMENTS["line"], TILTED)}, 3
    )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"full ROI at 0.05 m, {math.prod(FINE_FULL_ROI.shape) / 1e6:.1f} million voxels")
    for name, seconds in best.items():
        print(f"  {name:14} {seconds:.3f} s")
    print(
        f"  the POG and its columns took {made:.1f} s; peak memory of this process {memory:.2f} GiB"
    )


def batch(pog: OccupancyGrid) -> None:
    """Placements a second, one by one and as a batch."""
    rng = np.random.default_rng(1)
    placements = [
        Placement(
            f"random {n}",
            [
                Mount(*rng.uniform((-1, -1, 1.5, -0.3, -0.3, -3), (1, 1, 3, 0.3, 0.3, 3)))
                for _ in range(4)
            ],
            lidar=Lidar.paper(),
        )
        for n in range(64)
    ]
    best = minima(
        {
            "one by one": lambda: [evaluate(pog, p) for p in placements],
            "as a batch": lambda: evaluate_many({"Car": pog}, placements),
        },
        3,
    )
    print(f"64 random placements of four LiDARs, batch on {numba.get_num_threads()} threads")
    for name, seconds in best.items():
        print(f"  {name}: {64 / seconds:6.1f} a second")
    print(f"  ratio {best['one by one'] / best['as a batch']:.2f}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--batch", action="store_true", help="only the batch, on all cores")
    arguments = parser.parse_args()
    boxes = traffic()
    pog = grid(boxes)
    if arguments.batch:
        batch(pog)
        return
    methods(pog)
    needed(boxes, pog)
    one_mount(pog)
    fine(boxes)


if __name__ == "__main__":
    main()
