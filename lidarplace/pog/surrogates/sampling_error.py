"""Sampling error of surrogates: the POG was counted over these frames and no others.

Frames that follow each other show the same objects, so blocks of consecutive frames of one route
are drawn with replacement (moving traffic forgets itself within a block), and every surrogate is
computed again from the POG of what was drawn.

Entropies of a POG from few frames are too low: voxels look more certain than they are (Miller and
Madow, 1955). The resamples show how much, since they know the log as the log knows the traffic:
`bias` is their mean less the value."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.coverage import Method, coverage, rays_of
from lidarplace.coverage.rays import log_miss, ray_counts
from lidarplace.logs.boxes import frame_keys
from lidarplace.pog.occupancy.block_counts import BlockCounts
from lidarplace.pog.occupancy.entropy import entropy_of_counts
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.formulas import (
    Crossings,
    expected_ig,
    expected_points,
    information,
    log_miss_of_ray,
)
from lidarplace.pog.surrogates.inputs import SurrogateInputs
from lidarplace.pog.surrogates.result import CoveredVoxels, Surrogates
from lidarplace.pog.surrogates.table import ASKED_OF_POG, POG_SURROGATES, SURROGATES
from lidarplace.rigs.placement import Placement

NORMAL_95 = 1.959963984540054
"""97.5 % quantile of the normal distribution."""


@dataclass(frozen=True)
class SamplingError:
    """Sampling error of the surrogates of one placement.

    `estimates` has one row per (class, surrogate): value; sd, standard deviation of the resamples;
    bias, mean of the resamples less the value; low and high, the 95 % interval `value - bias ± 1.96
    sd`; blocks; resamples. `resamples` has class, surrogate, resample (0, 1, ...) and value.
    Placements with the same frames, blocks and seed have the same draws, so they can be paired."""

    estimates: pd.DataFrame
    resamples: pd.DataFrame


def pog_sampling_error(
    boxes: pd.DataFrame,
    frames: pd.DataFrame,
    roi: Roi,
    classes: Collection[str],
    placement: Placement,
    method: Method = "cone",
    detection_probability: float = 0.1,
    occlusion: bool = False,
    blocks: int = 40,
    resamples: int = 200,
    seed: int = 0,
    surrogates: Collection[str] = ASKED_OF_POG.own,
) -> SamplingError:
    """Estimate the sampling error of every surrogate of `placement`, by a bootstrap over blocks.

    `resamples` draws by `seed` take as many blocks as there are, see `frame_blocks`.

    With `occlusion` the rays keep the weights w_r of the POG of all frames; only p is resampled. It
    is several times slower then: no two voxels share ln(1 - d). Boxes of frames that are not in
    `frames` are left out; `surrogates` may be of plug-ins. Raises ValueError: fewer than two blocks
    or resamples, or what `OccupancyGrid.by_class` raises."""
    if resamples < 2:
        raise InputError(key="resamples", expected="at least 2", found=resamples)
    of_frame = frame_blocks(frames, blocks)
    lengths = np.bincount(of_frame)
    if len(lengths) < 2:
        few = f"{len(lengths)} of {len(frames)} frames"
        raise InputError(key="blocks", expected="at least 2", found=few)
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(lengths), np.full(len(lengths), 1 / len(lengths)), resamples)
    every = ((name, SURROGATES[name].of_seen) for name in (*POG_SURROGATES.own, *surrogates))
    computed = {name: of_seen for name, of_seen in every if of_seen is not None}
    rig = f"placement {placement.name}"
    draws = np.vstack([np.ones_like(lengths), drawn])  # the log itself first
    keys = frame_keys(boxes, frames)
    blocked = boxes[keys].merge(frames[keys].assign(block=of_frame), on=keys, how="left")
    block_of_box = blocked["block"].to_numpy()  # NaN for a box of another frame
    covered = coverage(placement, roi, method).reshape(-1)
    ray_method = rays_of(method)
    rays = ray_counts(placement, roi, ray_method).reshape(-1)
    totals = draws @ lengths
    all_covered = CoveredVoxels(partial(int, np.count_nonzero(covered)))
    rows, resampled = [], []
    for object_class in classes:
        histories = BlockCounts.of_blocks(
            OccupancyGrid.from_boxes(boxes[block_of_box == b], roi, object_class, int(n)).counts
            for b, n in enumerate(lengths)
        )
        occupied_voxels = histories.voxels
        if occlusion:
            occupied = np.zeros(covered.size, np.int32)
            occupied[occupied_voxels] = histories.counts(draws[0])[histories.history]
            log = occupied.reshape(roi.shape), int(totals[0])
            log_misses = log_miss(placement, roi, ray_method, *log, detection_probability)
            log_misses = log_misses.reshape(-1)[occupied_voxels]
        voxels = _by_history(histories, np.ones(len(occupied_voxels), np.int64))
        covered_voxels = _by_history(histories, covered[occupied_voxels])
        crossings_of = _crossings_of(histories, rays[occupied_voxels])
        values: dict[str, list[float]] = {name: [] for name in surrogates}
        for draw, total in zip(draws, totals.tolist(), strict=True):
            counts = histories.counts(draw)
            levels = np.arange(1, int(counts.max()) + 1)
            of_level = np.bincount(counts, voxels)[1:]
            entropy = entropy_of_counts(levels, total)
            crossings = crossings_of(counts)
            gain = partial(expected_ig, total, crossings, log_miss_of_ray(detection_probability))
            if occlusion:
                gain = partial(_gain, counts[histories.history], total, log_misses)
            seen = SurrogateInputs(
                frames=total,
                counts=levels,
                voxels=of_level,
                covered=np.bincount(counts, covered_voxels)[1:],
                entropy=entropy,
                h_pog=math.fsum(of_level * entropy),
                crossings=partial(crossings_of, counts),
                points=partial(expected_points, total, crossings, 1.0),
                information=gain,
            )
            numbers = {
                name: SURROGATES.number(name, partial(compute, seen), rig)
                for name, compute in computed.items()
            }
            nonzero = int(seen.covered.sum())
            result = Surrogates(placement, roi, method, numbers, all_covered, nonzero, seconds=0.0)
            for name in surrogates:
                values[name].append(result.asked(name))
        for name, (value, *estimates) in values.items():
            labels = {"class": object_class, "surrogate": name}
            resample = np.array(estimates)
            bias, off = resample.mean() - value, NORMAL_95 * (sd := resample.std(ddof=1))
            ends = {"low": value - bias - off, "high": value - bias + off}
            sizes = {"blocks": len(lengths), "resamples": resamples}
            rows.append(labels | {"value": value, "sd": sd, "bias": bias} | ends | sizes)
            resampled.append(
                pd.DataFrame(labels | {"resample": range(resamples), "value": resample})
            )
    return SamplingError(pd.DataFrame(rows), pd.concat(resampled, ignore_index=True))


def frame_blocks(frames: pd.DataFrame, blocks: int) -> NDArray[np.int64]:
    """Return the block of every row of the frames table: consecutive frames of one route.

    A route gives blocks by its share of the frames, at least one, of equal length up to a frame; so
    their number is about `blocks`. Without a column `route` (or `scene`) the log is one route.
    Raises ValueError without a column `frame`, frames or blocks."""
    if "frame" not in frames.columns:
        raise InputError(key="frames", expected="a column frame", found=list(frames.columns))
    if blocks < 1 or not len(frames):
        found = f"{blocks} and {len(frames)}"
        raise InputError(expected="at least 1 block and 1 frame", found=found)
    keys = [key for key in ("scene", "route") if key in frames.columns]
    route = frames.groupby(keys).ngroup().to_numpy() if keys else np.zeros(len(frames), np.int64)
    result, first = np.empty(len(frames), np.int64), 0
    order = np.lexsort((frames["frame"].to_numpy(), route))
    for rows in np.split(order, np.flatnonzero(np.diff(route[order])) + 1):
        parts = min(len(rows), max(1, round(blocks * len(rows) / len(frames))))
        result[rows] = first + np.arange(len(rows)) * parts // len(rows)
        first += parts
    return result


def _by_history(histories: BlockCounts, amount: NDArray[np.generic]) -> NDArray[np.int64]:
    """Return sums over the voxels of every history, shape (nodes,); sums below 2**53 are exact."""
    return np.bincount(histories.history, amount, len(histories.parent)).astype(np.int64)


def _crossings_of(
    histories: BlockCounts, rays: NDArray[np.integer]
) -> Callable[[NDArray[np.int64]], Crossings]:
    """Return a function of the counts of the histories: their crossings.

    Voxels of equal history and rays are one term."""
    base = int(rays.max(initial=0)) + 1
    pairs, voxels = np.unique(histories.history * np.int64(base) + rays, return_counts=True)
    history, crossing = np.divmod(pairs, base)

    def crossings(counts: NDArray[np.int64]) -> Crossings:
        count = counts[history]
        met = (crossing > 0) & (count > 0)
        return Crossings(count[met], crossing[met], voxels[met])

    return crossings


def _gain(count: NDArray[np.int64], frames: int, log_misses: NDArray[np.float64]) -> float:
    """Return expected_ig with occlusion: every voxel has its own ln(1 - d)."""
    met = (log_misses < 0) & (count > 0)
    p, rest = count[met] / frames, (frames - count[met]) / frames
    return float(information(p, rest, log_misses[met]).sum())
