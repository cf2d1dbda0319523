"""Placements in, surrogates out: one placement, several classes, or many placements at once."""

from __future__ import annotations

import functools
import reprlib
import time
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.base.suggestions import did_you_mean
from lidarplace.coverage import Method, check_method, count_covered, covered_bits, rays_of
from lidarplace.coverage.bits import pack
from lidarplace.coverage.rays import RayMethod, log_miss, ray_counts, ray_weight
from lidarplace.coverage.tiles import Tiles
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.formulas import (
    Crossings,
    expected_ig,
    expected_ig_with_occlusion,
    expected_points,
    log_miss_of_ray,
)
from lidarplace.pog.surrogates.inputs import SurrogateInputs
from lidarplace.pog.surrogates.result import CoveredVoxels, Surrogates
from lidarplace.pog.surrogates.table import POG_SURROGATES, RAY_SURROGATES, SURROGATES
from lidarplace.rigs.placement import Placement


def evaluate(
    grid: OccupancyGrid,
    placement: Placement,
    method: Method = "cone",
    azimuth_steps: int | None = None,
    surrogates: Collection[str] = (),
    detection_probability: float = 0.1,
    occlusion: bool = False,
    azimuth_stride: int = 1,
) -> Surrogates:
    """Compute the surrogates of `placement` for the class of `grid`.

    Args:
        grid: POG of one class.
        placement: the rig.
        method: how coverage is computed, see `lidarplace.coverage.coverage`.
        azimuth_steps: rays of a beam in one turn instead of the LiDAR's own number; a pattern stays
            as it is.
        surrogates: names from RAY_SURROGATES, or of plug-ins, to compute as well; the others always
            are. With `method="cone"` ray counts come from `dda`.
        detection_probability: q, the chance that a ray which crosses an occupied voxel detects it.
        occlusion: whether rays are weakened by the voxels that they pass first (expected_ig).
        azimuth_stride: count only every so many rays of a beam, each in the place of as many;
            faster, less accurate, and for the RAY_SURROGATES alone.

    Raises ValueError: an unknown method or surrogate, q outside (0, 1], or a stride below 1."""
    check_grid(grid)
    settings = (azimuth_steps, surrogates, detection_probability, occlusion, azimuth_stride)
    results = evaluate_classes({grid.object_class: grid}, placement, method, *settings)
    return results[grid.object_class]


def check_grid(grid: OccupancyGrid) -> None:
    """Raise ValueError unless `grid` is an OccupancyGrid."""
    if not isinstance(grid, OccupancyGrid):
        raise InputError(key="grid", expected="an OccupancyGrid", found=reprlib.repr(grid))


def evaluate_many(
    grids: Mapping[str, OccupancyGrid], placements: Sequence[Placement], **options: Any
) -> list[dict[str, Surrogates]]:
    """Run `evaluate_classes` for many placements on all cores, in the order of `placements`.

    A sensor that several placements share is covered once. Threads are as many as numba's
    (`NUMBA_NUM_THREADS`). `options` are the keywords of `evaluate_classes`."""
    for grid in grids.values():
        grid.prepare()  # once, before the threads start
    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        return list(threads.map(functools.partial(evaluate_classes, grids, **options), placements))


def compare(placements: Sequence[Placement], grid: OccupancyGrid, **options: Any) -> pd.DataFrame:
    """Compute surrogates of several placements for the class of `grid`.

    A row is a placement, in the order given, a column a surrogate that was computed.

    `options` are the keywords of `evaluate_classes`, such as `surrogates=["expected_ig"]`. Raises
    ValueError if two placements have one name, or as `evaluate`."""
    check_grid(grid)
    names = pd.Index([placement.name for placement in placements], name="placement")
    if (twice := names[names.duplicated()]).size:
        raise InputError("duplicate name", key="placements", found=repr(twice[0]))
    results = evaluate_many({grid.object_class: grid}, placements, **options)
    of_class = [result[grid.object_class] for result in results]
    computed = POG_SURROGATES.among((*SURROGATES.own, *of_class[0].values))
    values = {name: [result[name] for result in of_class] for name in computed}
    return pd.DataFrame(values, index=names).dropna(axis="columns", how="all")


def evaluate_classes(
    grids: Mapping[str, OccupancyGrid],
    placement: Placement,
    method: Method = "cone",
    azimuth_steps: int | None = None,
    surrogates: Collection[str] = (),
    detection_probability: float = 0.1,
    occlusion: bool = False,
    azimuth_stride: int = 1,
) -> dict[str, Surrogates]:
    """Run `evaluate` for several classes on one ROI; work that all classes share is done once.

    `seconds` of each class is the common part plus its own, without what depends on the POG alone,
    which is computed with the first placement and kept."""
    _check_arguments(placement, surrogates)
    check_method(method)
    _check_probability(detection_probability)
    roi = common_roi(grids)
    if azimuth_steps is not None:
        placement = placement.each_lidar(
            lambda lidar: (
                replace(lidar, azimuth_steps=azimuth_steps) if lidar.pattern is None else lidar
            )
        )
    tiles = occupied_tiles(grids)
    for grid in grids.values():
        grid.prepare()

    start = time.perf_counter()
    ray_method = rays_of(method)
    computed = {
        name: entry.of_seen
        for name in dict.fromkeys((*SURROGATES.own, *surrogates))
        if (entry := SURROGATES[name]).of_seen and (name in surrogates or not entry.needs_rays)
    }
    same_rays = method == ray_method and azimuth_stride == 1
    occupied = occupied_layers(roi, tiles, ray_method)
    counts, entries = None, [SURROGATES[name] for name in computed]
    if any(entry.needs_rays and not (occlusion and entry.occludes) for entry in entries):
        counts = ray_counts(placement, roi if same_rays else occupied, ray_method, azimuth_stride)
    if counts is not None and same_rays:
        covered = pack(counts > 0)
    else:
        covered = covered_bits(placement, roi, method, tiles)
    # Rays pass all voxels anyway; cones are followed there once the number is read.
    whole = functools.partial(count_covered, placement, roi, method)
    if method != "cone":
        whole = functools.partial(int, np.bitwise_count(covered).sum())
    voxels = CoveredVoxels(whole)
    rays = placement, occupied, ray_method, detection_probability, azimuth_stride
    common, rig = time.perf_counter() - start, f"placement {placement.name}"

    results = {}
    for object_class, grid in grids.items():
        start = time.perf_counter()
        seen = _seen(grid, grid.levels.covered(covered), counts, rays, occlusion)
        values = {
            name: SURROGATES.number(name, functools.partial(compute, seen), rig)
            for name, compute in computed.items()
        }
        nonzero, seconds = int(seen.covered.sum()), common + time.perf_counter() - start
        result = Surrogates(placement, roi, method, values, voxels, nonzero, seconds)
        results[object_class] = result
    return results


def _seen(
    grid: OccupancyGrid,
    covered: NDArray[np.int64],
    counts: NDArray[np.int32] | None,
    rays: tuple[Placement, Roi, RayMethod, float, int],
    occlusion: bool,
) -> SurrogateInputs:
    """Return the inputs of the surrogates of a class.

    `covered` are voxels by level, and `counts` rays through every voxel, None if no surrogate needs
    these; `rays` are those of `log_miss_in`."""
    placement, _, _, q, stride = rays

    @functools.cache
    def crossings() -> Crossings:
        if counts is None:
            raise InputError("rays are not counted", key="needs_rays", expected="True", found=False)
        return Crossings.of_grid(grid, counts)

    def information() -> float:
        if occlusion:
            return expected_ig_with_occlusion(grid, log_miss_in(grid, *rays))
        log_miss = ray_weight(placement, stride) * log_miss_of_ray(q)
        return expected_ig(grid.frames, crossings(), log_miss)

    return SurrogateInputs(
        frames=grid.frames,
        counts=grid.levels.counts,
        voxels=grid.levels.total,
        covered=covered,
        entropy=grid.entropy_of_level,
        h_pog=grid.h_pog,
        crossings=crossings,
        points=lambda: expected_points(grid.frames, crossings(), ray_weight(placement, stride)),
        information=information,
    )


def log_miss_in(
    grid: OccupancyGrid,
    placement: Placement,
    occupied: Roi,
    method: RayMethod,
    q: float,
    azimuth_stride: int,
) -> NDArray[np.float64]:
    """Return `log_miss` of the class of a grid in its `occupied_layers`."""
    counts = grid.counts[..., : occupied.shape[2]]
    return log_miss(placement, occupied, method, counts, grid.frames, q, azimuth_stride)


def expected_ig_of_rays(
    grids: Mapping[str, OccupancyGrid], placement: Placement, q: float, azimuth_stride: int = 1
) -> pd.Series[float]:
    """Return `expected_ig` without occlusion by class (index), in nats; no cone is followed.

    `q` is the detection probability of a ray. Raises ValueError for q outside (0, 1], or grids of
    different ROIs."""
    return _expected_ig_of_rays(grids, placement, [q], azimuth_stride)[q]


FAINT_Q = 1e-7
"""A probability of detection so small that `expected_ig` is proportional to it."""
MOSTLY_LINEAR = 2 / 3
"""A `linear_share` beyond which `expected_ig` ranks placements by the number of their rays within
objects rather than by what these cover (`python benchmarks/studies/expected_ig_regime.py`)."""


def linear_share(
    grids: Mapping[str, OccupancyGrid], placement: Placement, q: float
) -> pd.Series[float]:
    """Return the share of `expected_ig` in its value if every ray counted by itself, by class.

    A voxel that m rays cross is detected with d = 1 - (1 - q)^m. Where q m is small in all of them
    d is q m and `expected_ig` a sum over rays: the share is 1, or a hair more, as information is
    convex in d. As rays, q or voxels grow it falls, and `expected_ig` comes to be
    `covered_entropy`. NaN for a class that no ray meets. Raises as `expected_ig_of_rays`."""
    gains = _expected_ig_of_rays(grids, placement, [q, FAINT_Q])
    return gains[q] / (gains[FAINT_Q] * (q / FAINT_Q))


def _expected_ig_of_rays(
    grids: Mapping[str, OccupancyGrid],
    placement: Placement,
    qs: Sequence[float],
    azimuth_stride: int = 1,
) -> pd.DataFrame:
    """Trace the rays once and return `expected_ig`: a row per class, a column per q."""
    for q in qs:
        _check_probability(q)
    roi = occupied_layers(common_roi(grids), occupied_tiles(grids), "dda")
    rays = ray_counts(placement, roi, "dda", azimuth_stride)
    weight = ray_weight(placement, azimuth_stride)
    misses = {q: weight * log_miss_of_ray(q) for q in qs}
    gains = {}
    for name, grid in grids.items():
        crossings = Crossings.of_grid(grid, rays)
        gains[name] = {q: expected_ig(grid.frames, crossings, miss) for q, miss in misses.items()}
    return pd.DataFrame.from_dict(gains, orient="index")


def common_roi(grids: Mapping[str, OccupancyGrid]) -> Roi:
    """Return the ROI of all classes. Raises ValueError if they differ."""
    rois = {grid.roi for grid in grids.values()}
    if len(rois) != 1:
        raise InputError(key="grids", expected="one ROI", found=len(rois))
    return rois.pop()


def occupied_tiles(grids: Mapping[str, OccupancyGrid]) -> Tiles:
    """Return the tiles in which any of the classes is."""
    return functools.reduce(Tiles.__or__, (grid.levels.tiles for grid in grids.values()))


def occupied_layers(roi: Roi, tiles: Tiles, method: RayMethod) -> Roi:
    """Return `roi` up to the highest layer that matters; the whole for `bresenham`.

    Its lines depend on where they leave the ROI."""
    if method == "bresenham":
        return roi
    layers = max(1, int(tiles.highest.max()) + 1)
    return replace(roi, z=(roi.z[0], roi.z[0] + layers * roi.resolution))


def _check_arguments(placement: Placement, surrogates: Collection[str]) -> None:
    """Raise ValueError for another kind of argument, an unknown name, or a broken plug-in."""
    if not isinstance(placement, Placement):
        example = "a Placement, such as PAPER_PLACEMENTS['line']"
        raise InputError(key="placement", expected=example, found=reprlib.repr(placement))
    if isinstance(surrogates, str):
        several = f"a list, such as [{surrogates!r}]"
        raise InputError(key="surrogates", expected=several, found=repr(surrogates))
    for name in surrogates:
        plug_in = SURROGATES.path(name) is not None and not SURROGATES[name].of_objects
        if not plug_in and name not in RAY_SURROGATES.own:
            choices = (
                f"{', '.join(RAY_SURROGATES.own)} (the others are always computed) or a plug-in"
            )
            suggestion = f"{name!r}{did_you_mean(name, RAY_SURROGATES.own)}"
            raise InputError(key="surrogates", expected=choices, found=suggestion)


def _check_probability(q: float) -> None:
    if not 0 < q <= 1:
        raise InputError(key="detection_probability", expected="a number within (0, 1]", found=q)
