"""The surrogates of a placement: S-MIG and others, all from one coverage (docs/method.md)."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.coverage import Method, coverage
from lidarplace.coverage.rays import RayMethod, log_miss, ray_counts
from lidarplace.occupancy import OccupancyGrid
from lidarplace.placement import Placement

RAY_SURROGATES = ("expected_points", "expected_ig")
"""Surrogates that need the number of rays through every voxel; computed when asked for."""


@dataclass(frozen=True)
class Surrogates:
    """Surrogates of one placement for one class; entropies in nats.

    Attributes:
        s_mig: `-sum over covered v of H(v)`, the paper's S-MIG to the letter.
        ig: `h_pog + s_mig`, the paper's information gain.
        h_pog: `sum over v of H(v)`, the entropy of the POG.
        covered_entropy: `sum over covered v of H(v)`.
        residual_entropy: `h_pog - covered_entropy`, what stays unseen.
        m_sog: `s_mig / N` with N = covered_voxels (Place3D, NeurIPS 2024); NaN for N = 0.
        expected_points: `sum of m(v) p(v)`, m(v) rays through v; None unless asked for.
        expected_ig: mutual information with a sensor that can miss; None unless asked for.
        covered_voxels: covered voxels of the ROI.
        covered_nonzero: covered voxels with p > 0.
        seconds: wall time of the evaluation.
    """

    s_mig: float
    ig: float
    h_pog: float
    covered_entropy: float
    residual_entropy: float
    m_sog: float
    expected_points: float | None
    expected_ig: float | None
    covered_voxels: int
    covered_nonzero: int
    seconds: float


def evaluate(
    grid: OccupancyGrid,
    placement: Placement,
    method: Method = "cone",
    azimuth_steps: int | None = None,
    surrogates: Collection[str] = (),
    detection_probability: float = 0.1,
    occlusion: bool = False,
) -> Surrogates:
    """Surrogates of `placement` for the class of `grid`.

    Args:
        method: how coverage is computed, see `lidarplace.coverage.coverage`.
        azimuth_steps: rays of a beam in one turn instead of the LiDAR's own number.
        surrogates: names from RAY_SURROGATES to compute as well; the others always are. With
            `method="cone"` their ray counts come from `dda`.
        detection_probability: q, the chance that a ray which crosses an occupied voxel detects it.
        occlusion: whether rays are weakened by the voxels that they pass first (expected_ig).

    Raises:
        ValueError: an unknown method or surrogate, or q outside (0, 1].
    """
    result = evaluate_classes(
        {grid.object_class: grid},
        placement,
        method,
        azimuth_steps,
        surrogates,
        detection_probability,
        occlusion,
    )
    return result[grid.object_class]


def evaluate_classes(
    grids: Mapping[str, OccupancyGrid],
    placement: Placement,
    method: Method = "cone",
    azimuth_steps: int | None = None,
    surrogates: Collection[str] = (),
    detection_probability: float = 0.1,
    occlusion: bool = False,
    covered: NDArray[np.bool_] | None = None,
) -> dict[str, Surrogates]:
    """`evaluate` for several classes on one ROI; what does not depend on the class is done once.

    `covered` is the coverage by `method` where the caller has it already. `seconds` of each class
    is the common part plus its own.
    """
    unknown = sorted(set(surrogates) - set(RAY_SURROGATES))
    if unknown:
        raise ValueError(
            f"surrogates takes {', '.join(RAY_SURROGATES)} (the others are always computed), "
            f"found {unknown[0]!r}"
        )
    if not 0 < detection_probability <= 1:
        raise ValueError(
            f"detection_probability must be within (0, 1], found {detection_probability}"
        )
    rois = {grid.roi for grid in grids.values()}
    if len(rois) != 1:
        raise ValueError(f"the grids must share one ROI, found {len(rois)}")
    roi = rois.pop()
    if azimuth_steps is not None:
        placement = placement.with_lidar(replace(placement.lidar, azimuth_steps=azimuth_steps))

    start = time.perf_counter()
    if covered is None:
        covered = coverage(placement, roi, method)
    ray_method: RayMethod = "bresenham" if method == "bresenham" else "dda"
    by_count = set(surrogates) - ({"expected_ig"} if occlusion else set())
    counts = ray_counts(placement, roi, ray_method) if by_count else None
    common = time.perf_counter() - start

    results = {}
    for object_class, grid in grids.items():
        start = time.perf_counter()
        points = gain = None
        if counts is not None and "expected_points" in surrogates:
            points = expected_points(grid, counts)
        if "expected_ig" in surrogates:
            misses = (
                log_miss(placement, roi, ray_method, grid.probability, detection_probability)
                if counts is None or occlusion
                else log_miss_of_counts(counts, detection_probability)
            )
            gain = expected_ig(grid, misses)
        h_pog = grid.entropy_sum()
        covered_entropy = grid.entropy_sum(covered)
        voxels = int(np.count_nonzero(covered))
        results[object_class] = Surrogates(
            s_mig=-covered_entropy,
            ig=h_pog - covered_entropy,
            h_pog=h_pog,
            covered_entropy=covered_entropy,
            residual_entropy=h_pog - covered_entropy,
            m_sog=-covered_entropy / voxels if voxels else math.nan,
            expected_points=points,
            expected_ig=gain,
            covered_voxels=voxels,
            covered_nonzero=int(np.count_nonzero(covered & (grid.counts > 0))),
            seconds=common + time.perf_counter() - start,
        )
    return results


def expected_points(grid: OccupancyGrid, rays: NDArray[np.int32]) -> float:
    """`sum of m(v) p(v)`: rays that meet an object in a frame, if nothing hid anything.

    The sum is over integers, and divided by T once.
    """
    return int(np.dot(rays.reshape(-1).astype(np.int64), grid.counts.reshape(-1))) / grid.frames


def log_miss_of_counts(rays: NDArray[np.int32], q: float) -> NDArray[np.float64]:
    """`ln (1 - q)^m`: log-probability that none of m rays detects, shape of `rays`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rays > 0, rays * np.log1p(-q), 0.0)


def expected_ig(grid: OccupancyGrid, log_miss: NDArray[np.float64]) -> float:
    """Mutual information, in nats, between occupancy and a sensor that can miss.

    With `d = 1 - exp(log_miss)` the probability that an object in v is detected, no false alarms:
    `I(v) = H(p) - (1 - p d) h(p (1 - d) / (1 - p d))`, h the binary entropy; the sum over v.
    """
    occupied = (grid.counts > 0) & (log_miss < 0)
    p = grid.counts[occupied] / grid.frames
    rest = (grid.frames - grid.counts[occupied]) / grid.frames
    return float(np.sum(information(p, rest, log_miss[occupied])))


@njit(cache=True)
def information(p, rest, log_miss):  # pragma: no cover - compiled
    """I(v) of `expected_ig` for arrays of p > 0, rest = 1 - p and log_miss < 0.

    Written without the difference of two entropies, which cancels where d or p is small:
    with g(x) = (1 - x) ln(1 - x) + x, `I = -p d ln p + p g(d) - g(p d)`.
    """
    result = np.empty(len(p))
    for i in range(len(p)):
        d = -math.expm1(log_miss[i])
        log_p = math.log(p[i]) if p[i] < 0.5 else math.log1p(-rest[i])
        g = np.zeros(2)
        for side in range(2):
            x = d if side == 0 else p[i] * d
            if x < 1e-3:  # series: x^2/2 + x^3/6 + x^4/12 + ..., next term below 1e-16 relative
                g[side] = (
                    x
                    * x
                    * (1 / 2 + x * (1 / 6 + x * (1 / 12 + x * (1 / 20 + x * (1 / 30 + x / 42)))))
                )
            elif x < 1:
                left = math.exp(log_miss[i]) if side == 0 else rest[i] + p[i] * (1 - d)
                g[side] = left * math.log1p(-x) + x
            else:
                g[side] = 1.0
        result[i] = -p[i] * d * log_p + p[i] * g[0] - g[1]
    return result
