"""Errors of the surrogate mathematics over random and extreme inputs, against exact references.

    PYTHONPATH=. OMP_NUM_THREADS=1 python benchmarks/numerics.py

About a minute. References have 50 digits or more (mpmath) or are rational; they are those of
`tests/lidarplace/test_extremes.py`. Sums and information: worst relative error. Cones: the change
of a voxel, as a share of its edge, that explains every voxel on which an exact cone and one of the
two algorithms disagree (0: they agree); how many voxels are `missed`, that is, meet an exact cone
and are not covered; on how many the two algorithms `differ`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from fractions import Fraction

import mpmath
import numpy as np

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.coverage import coverage
from lidarplace.coverage.rays import ray_counts
from lidarplace.pog.occupancy.box_counts import count_boxes
from lidarplace.pog.occupancy.entropy import binary_entropy
from lidarplace.pog.surrogates.formulas import information
from tests.lidarplace.test_extremes import (
    DIGITS,
    exact_entropy,
    exact_entropy_sum,
    exact_information,
    exactly_covered,
)
from tests.lidarplace.voxel_by_voxel import covered_voxel_by_voxel

ROI = Roi(x=(0.0, 0.6), y=(-0.3, 0.3), z=(0.0, 0.4), resolution=0.1)
MANY = 10**7
RIGHT_ANGLE = math.pi / 2
LOG_MISSES = (-1e-300, -1e-12, -1e-6, -1e-3, -2e-3, -0.1, -1.0, -5.0, -40.0, -700.0, -math.inf)
CHANGES = (
    1e-12,
    1e-10,
    1e-9 + 1e-12,
    2e-9,
    5e-9,
    1e-8,
    2e-8,
    5e-8,
    1e-7,
    2e-7,
    5e-7,
    1e-6,
    1e-5,
    1e-3,
)

Case = tuple[Mount, list[float]]
rng = np.random.default_rng(0)


def relative(found: float, exact: mpmath.mpf, scale: mpmath.mpf | None = None) -> float:
    """|found - exact| / scale, the scale being `exact` unless given; 0 / 0 is 0."""
    scale = exact if scale is None else scale
    difference = abs(mpmath.mpf(float(found)) - exact)
    return float(difference / scale) if difference else 0.0


def report(case: str, inputs: int, reference: str, worst: str, start: float) -> None:
    seconds = time.perf_counter() - start
    print(f"{case:45s}{inputs:8d}  {reference:9s}  {worst:34s}{seconds:6.1f}", flush=True)


# Entropies and information.


def entropies() -> None:
    start, worst = time.perf_counter(), 0.0
    smalls = [*10.0 ** rng.uniform(-300, -0.4, 2000), 1e-300, 1e-16, 5e-324]
    with mpmath.workdps(400):
        for small in smalls:
            p = mpmath.mpf(small)
            exact = -p * mpmath.log(p) - (1 - p) * mpmath.log(1 - p)
            for pair in ((small, 1 - small), (1 - small, small)):
                if small > 1e-307:  # below floats lose digits
                    worst = max(worst, relative(float(binary_entropy(*pair)), exact))
    report("H, p from 1e-307 to 1 - 1e-307", 2 * len(smalls), "mpmath", f"{worst:.1e}", start)


def information_errors(case: str, pairs: Iterable[tuple[float, float]]) -> None:
    start, worst, tried = time.perf_counter(), (0.0, ""), 0
    for p, rest in pairs:
        for log_miss in LOG_MISSES:
            exact = exact_information(p, rest, log_miss)
            if exact > 1e-290:
                found = information(np.array([p]), np.array([rest]), np.array([log_miss]))[0]
                worst = max(worst, (relative(found, mpmath.mpf(exact)), f"ln(1-d) = {log_miss:g}"))
                tried += 1
    report(case, tried, "mpmath", f"{worst[0]:.1e} at {worst[1]}", start)


def all_information() -> None:
    shares = [(c / MANY, (MANY - c) / MANY) for c in rng.integers(1, MANY // 2, 100).tolist()]
    tiny = [(s, 1 - s) for s in 10.0 ** rng.uniform(-250, -1, 60)]
    information_errors("I, T = 1e7, p < 1/2", shares)
    information_errors("I, T = 1e7, p > 1/2", [(rest, p) for p, rest in shares])
    information_errors("I, p from 1e-250 to 0.1", tiny)
    information_errors("I, 1 - p from 1e-250 to 0.1", [(rest, p) for p, rest in tiny])
    information_errors("I, p = 1 - 1e-7", [((MANY - 1) / MANY, 1 / MANY)])


# Sums.


def grids() -> Iterable[OccupancyGrid]:
    """Counts anywhere, counts at both ends, and tiny entropies beside large ones."""
    for frames in (2, 3, 1000, MANY):
        ends = np.unique(np.clip([0, 1, 2, frames // 2, frames - 1, frames], 0, frames))
        anywhere = rng.integers(0, frames + 1, ROI.shape)
        few = np.where(rng.random(ROI.shape) < 0.05, 1, frames // 2)
        for counts in (anywhere, rng.choice(ends, ROI.shape), few):
            yield OccupancyGrid(ROI, "Car", counts.astype(np.int32), frames)


def random_placement(beams: int) -> Placement:
    mount = Mount(*rng.uniform(-0.1, 0.6, 3), *rng.uniform(-math.pi, math.pi, 3))
    return Placement("random", [mount], lidar=Lidar(tuple(rng.uniform(-1.5, 1.5, beams)), 90))


def sums() -> None:
    start, tried = time.perf_counter(), 0
    seen_error = total_error = points_error = 0.0
    residual_error = {"h_pog": 0.0, "itself": 0.0}
    for grid in grids():
        total = exact_entropy_sum(grid.counts, grid.frames)
        for beams in (1, 4, 40):
            placement = random_placement(beams)
            result = evaluate(grid, placement, surrogates=["expected_points"])
            covered = coverage(placement, ROI)
            seen = exact_entropy_sum(grid.counts[covered], grid.frames)
            unseen = exact_entropy_sum(grid.counts[~covered], grid.frames)
            seen_error = max(seen_error, relative(-result.s_mig, seen))
            total_error = max(total_error, relative(result.h_pog, total))
            for name, scale in (("h_pog", total), ("itself", unseen)):
                if scale:
                    error = relative(result.ig, unseen, scale)
                    residual_error[name] = max(residual_error[name], error)
            rays = ray_counts(placement, ROI, "dda").ravel().tolist()
            pairs = zip(rays, grid.counts.ravel().tolist(), strict=True)
            points = Fraction(sum(m * c for m, c in pairs), grid.frames)
            assert result.expected_points is not None
            points_error = max(points_error, abs(result.expected_points - float(points)))
            tried += 1
    report("s_mig", tried, "mpmath", f"{seen_error:.1e}", start)
    report("h_pog", tried, "mpmath", f"{total_error:.1e}", start)
    report(
        "ig, residual_entropy; share of h_pog",
        tried,
        "mpmath",
        f"{residual_error['h_pog']:.1e}",
        start,
    )
    report("expected_points; points", tried, "rational", f"{points_error:.1e}", start)


def nearly_all_covered() -> None:
    """A residual of one voxel with p = 1e-7 beside a grid of p = 1/2 that is covered."""
    start = time.perf_counter()
    level = Placement("level", [Mount(0.05, 0.05, 0.25)], lidar=Lidar((0.0,), 4))
    covered = coverage(level, ROI)
    counts = np.where(covered, MANY // 2, 0).astype(np.int32)
    counts[tuple(np.argwhere(~covered)[0])] = 1
    result = evaluate(OccupancyGrid(ROI, "Car", counts, MANY), level)
    error = relative(result.residual_entropy, exact_entropy(1, MANY))
    report(
        f"residual of 1.7e-6 nats beside {result.covered_entropy:.0f}; of itself",
        1,
        "mpmath",
        f"{error:.1e}",
        start,
    )


def behind_an_opaque_voxel() -> None:
    """Rays that pass a voxel of 1 - p = 1e-7 first; only what lies behind it is compared."""
    start, worst = time.perf_counter(), 0.0
    roi = Roi((0.0, 4.0), (0.0, 1.0), (0.0, 1.0), 1.0)
    ahead = Placement("ahead", [Mount(-1.0, 0.5, 0.5)], lidar=Lidar((0.0,), 1))
    options = {"surrogates": ["expected_ig"], "occlusion": True}
    for q in (1e-12, 0.1, 1.0):
        counts = np.array([MANY - 1, MANY // 2, MANY // 3, 1], np.int32).reshape(4, 1, 1)
        first = counts.copy()
        first[1:] = 0
        both, alone = (
            evaluate(OccupancyGrid(roi, "Car", c, MANY), ahead, detection_probability=q, **options)  # type: ignore[arg-type]
            for c in (counts, first)
        )
        assert both.expected_ig is not None
        assert alone.expected_ig is not None
        with mpmath.workdps(DIGITS):
            reach, exact = mpmath.mpf(1), mpmath.mpf(0)
            for count in counts.ravel().tolist():
                p = mpmath.mpf(count) / MANY
                exact += exact_information(
                    p, 1 - p, mpmath.log(1 - q * reach) if q * reach < 1 else -mpmath.inf
                )
                reach *= 1 - p
        worst = max(worst, relative(both.expected_ig, exact))
    report("expected_ig behind a voxel of 1 - p = 1e-7", 3, "mpmath", f"{worst:.1e}", start)


# Cones.


def cones(case: str, cases: Iterable[Case], roi: Roi = ROI, reach: float = math.inf) -> None:
    start, tried, differ, missed, change = time.perf_counter(), 0, 0, 0, 0.0
    for mount, elevations in cases:
        placement = Placement("one", [mount], lidar=Lidar(tuple(elevations), 4, range=reach))
        by_column = coverage(placement, roi)
        by_voxel = covered_voxel_by_voxel(placement, roi)
        differ += np.count_nonzero(by_column != by_voxel)
        tried += by_column.size
        for voxel in np.ndindex(roi.shape):
            meets = exactly_covered(roi, mount, elevations, voxel)
            if meets == by_column[voxel] == by_voxel[voxel]:
                continue
            missed += meets
            sign = -1 if meets else 1
            explains = (
                g
                for g in CHANGES
                if exactly_covered(roi, mount, elevations, voxel, sign * g) != meets
            )
            change = max(change, next(explains, math.inf))
    report(case, tried, "mpmath", f"{change:.0e} missed {missed} differ {differ}", start)


def positions(roi: Roi) -> Iterable[tuple[float, float, float]]:
    """Inside a voxel, on a corner, on a face, 1e-9 m from it, outside and under the ground."""
    e, x = roi.resolution, roi.x[0]
    middle = roi.y[0] + 3 * e
    yield x + 3.3 * e, middle + 0.7 * e, 2.1 * e
    yield x + 2 * e, middle, e
    yield x + 2 * e, middle + 0.3 * e, 1.2 * e
    yield x + 2 * e + 1e-9, middle + 0.3 * e, 1.2 * e
    yield x - 1.5 * e, middle + 2.7 * e, 4.6 * e
    yield x + 1.6 * e, middle + 0.4 * e, -1.3 * e


def upright(degrees: Iterable[float], roi: Roi = ROI) -> list[Case]:
    return [(Mount(*p), [math.radians(d)]) for p in positions(roi) for d in degrees]


def turned(roi: Roi = ROI) -> list[Case]:
    turns = [
        {"roll": 1e-9},
        {"pitch": 1e-7},
        {"roll": RIGHT_ANGLE},
        {"pitch": -RIGHT_ANGLE},
        {"roll": math.pi},
    ]
    return [
        (Mount(*p, **turn), [elevation])
        for p in positions(roi)
        for turn in turns
        for elevation in (-0.7, 0.0)
    ]


def random_cones(number: int) -> list[Case]:
    return [
        (
            Mount(*rng.uniform(-1, 1, 3), *rng.uniform(-math.pi, math.pi, 3)),
            [float(rng.uniform(-1.55, 1.55))],
        )
        for _ in range(number)
    ]


def far(distance: float) -> list[Case]:
    return [
        (Mount(-distance, 0.07, 0.33), [0.0]),
        (Mount(-distance, 0.07, 0.33, pitch=0.3), [0.3]),
        (Mount(0.23, 0.07, distance, roll=0.1), [0.1 - RIGHT_ANGLE + 0.2]),
        (Mount(0.23, 0.07, distance, roll=-1.3), [0.3 - RIGHT_ANGLE]),
    ]


def scaled(edge: float) -> Roi:
    return Roi((0.0, 6 * edge), (-3 * edge, 3 * edge), (0.0, 4 * edge), edge)


def all_cones() -> None:
    cones("cones, random poses and beams", random_cones(60))
    cones("cones, upright, -60 to 60 degrees", upright((60, 1e-7, 0, -30, -45)))
    cones("cones, upright, +-89.999999 and +-90 degrees", upright((89.999999, 90, -90)))
    cones("cones, turned by 1e-9, 1e-7, 90, 180 degrees", turned())
    for distance in (1e3, 1e5, 1e7):
        cones(f"cones, sensor {distance:g} m away", far(distance))
    for height in (1.0, 10.0, 100.0):
        beside = [
            (Mount(0.2 + offset, 0.03, height), [-RIGHT_ANGLE])
            for offset in (1e-9, 1e-8, 1e-7, 3e-7, 1e-6, 2e-6)
        ]
        cones(f"cones, straight down beside a face, {height:g} m", beside)
    for edge in (1e-3, 1e3):
        roi = scaled(edge)
        cones(f"cones, voxels of {edge:g} m", upright((-30, 0), roi), roi)
    for offset in (1e4, 1e6):
        roi = Roi((offset, offset + 0.6), ROI.y, ROI.z, 0.1)
        cases = upright((-30, 0), roi) + turned(roi)[:10]
        cones(f"cones, ROI {offset:g} m from the origin", cases, roi)


# Boxes.


def boxes() -> None:
    """Boxes at yaw 0 whose faces lie on centres of voxels, in decimals that floats round."""
    start, differ, tried = time.perf_counter(), 0, 0
    edge = Fraction(ROI.resolution)
    for _ in range(200):
        centre = rng.integers(0, 13, 3) * 0.05 - [0, 0.3, 0]
        size = rng.integers(0, 9, 3) * 0.1
        found = count_boxes(np.array([[*centre, *size, 0.0]]), np.zeros(1, np.int64), ROI)
        expected = np.ones(ROI.shape, bool)
        for axis in range(3):
            low, half = Fraction(float(ROI.minimum[axis])), Fraction(float(size[axis])) / 2
            inside = [
                abs(low + (i + Fraction(1, 2)) * edge - Fraction(float(centre[axis]))) <= half
                for i in range(ROI.shape[axis])
            ]
            expected &= np.array(inside).reshape([-1 if a == axis else 1 for a in range(3)])
        differ += np.count_nonzero(found != expected)
        tried += found.size
    report(
        "boxes with faces on centres of voxels", tried, "rational", f"{differ} voxels differ", start
    )


def turned_boxes() -> None:
    """Boxes at any yaw up to 1e9, with faces anywhere."""
    start, differ, tried = time.perf_counter(), 0, 0
    for _ in range(40):
        x, y, z = rng.uniform(-0.2, 0.6, 3)
        length, width, height = rng.uniform(0, 0.6, 3)
        yaw = float(rng.uniform(-1e9, 1e9))
        found = count_boxes(
            np.array([[x, y, z, length, width, height, yaw]]), np.zeros(1, np.int64), ROI
        )
        with mpmath.workdps(DIGITS):
            cos, sin = mpmath.cos(yaw), mpmath.sin(yaw)
            for voxel, count in np.ndenumerate(found):
                dx, dy, dz = (
                    mpmath.mpf(float(ROI.minimum[a])) + (voxel[a] + 0.5) * mpmath.mpf(0.1) - c
                    for a, c in enumerate((float(x), float(y), float(z)))
                )
                inside = 2 * abs(dz) <= height and 2 * abs(cos * dx + sin * dy) <= length
                differ += int(count) != (inside and 2 * abs(cos * dy - sin * dx) <= width)
        tried += found.size
    report("boxes anywhere, yaw up to 1e9", tried, "mpmath", f"{differ} voxels differ", start)


def main() -> None:
    parts: list[Callable[[], None]] = [
        entropies,
        all_information,
        sums,
        nearly_all_covered,
        behind_an_opaque_voxel,
        boxes,
        turned_boxes,
        all_cones,
    ]
    print(f"{'case':45s}{'inputs':>8s}  reference  {'worst':34s}seconds")
    for part in parts:
        part()


if __name__ == "__main__":
    main()
