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
from lidarplace.coverage import coverage, rays_of
from lidarplace.coverage.rays import log_miss, ray_counts
from lidarplace.logs.box_log import BoxLog
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
from lidarplace.pog.surrogates.inputs import Sensing, SurrogateInputs
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


@dataclass(frozen=True)
class Bootstrap:
    """Settings of a bootstrap: about how many blocks, how many draws of as many, and the seed."""

    blocks: int = 40
    resamples: int = 200
    seed: int = 0

    def draws(self, lengths: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how often each block is taken: once in the log itself, then by each draw."""
        if self.resamples < 2:
            raise InputError(key="resamples", expected="at least 2", found=self.resamples)
        if len(lengths) < 2:
            few = f"{len(lengths)} of {lengths.sum()} frames"
            raise InputError(key="blocks", expected="at least 2", found=few)
        shares = np.full(len(lengths), 1 / len(lengths))
        rng = np.random.default_rng(self.seed)
        drawn = rng.multinomial(len(lengths), shares, self.resamples)
        return np.vstack([np.ones_like(lengths), drawn])


def pog_sampling_error(
    log: BoxLog,
    roi: Roi,
    classes: Collection[str],
    placement: Placement,
    surrogates: Collection[str] = ASKED_OF_POG.own,
    sensing: Sensing = Sensing(),
    bootstrap: Bootstrap = Bootstrap(),
) -> SamplingError:
    """Estimate the sampling error of every surrogate of `placement`, by a bootstrap over blocks.

    With occlusion the rays keep the weights w_r of the POG of all frames; only p is resampled. It
    is several times slower then: no two voxels share ln(1 - d). All rays are traced, whatever the
    stride of `sensing`. Boxes of frames that are not in the log are left out; `surrogates` may be
    of plug-ins. Raises ValueError: fewer than two blocks or resamples, or what
    `OccupancyGrid.by_class` raises."""
    boxes, frames = log.boxes, log.frames
    block_of_frame = frame_blocks(frames, bootstrap.blocks)
    lengths = np.bincount(block_of_frame)
    draws = bootstrap.draws(lengths)
    keys = frame_keys(boxes, frames)
    blocked = boxes[keys].merge(frames[keys].assign(block=block_of_frame), on=keys, how="left")
    block_of_box = blocked["block"].to_numpy()  # NaN for a box of another frame
    model = _Resampled(placement, roi, surrogates, sensing, draws, draws @ lengths)
    rows, resampled = [], []
    for object_class in classes:
        histories = BlockCounts.of_blocks(
            OccupancyGrid.from_boxes(boxes[block_of_box == b], roi, object_class, int(n)).counts
            for b, n in enumerate(lengths)
        )
        for name, (value, *estimates) in model.values(histories).items():
            labels = {"class": object_class, "surrogate": name}
            resample = np.array(estimates)
            bias, off = resample.mean() - value, NORMAL_95 * (sd := resample.std(ddof=1))
            ends = {"low": value - bias - off, "high": value - bias + off}
            sizes = {"blocks": len(lengths), "resamples": bootstrap.resamples}
            rows.append(labels | {"value": value, "sd": sd, "bias": bias} | ends | sizes)
            number = range(bootstrap.resamples)
            resampled.append(pd.DataFrame(labels | {"resample": number, "value": resample}))
    return SamplingError(pd.DataFrame(rows), pd.concat(resampled, ignore_index=True))


class _Resampled:
    """Surrogates of one placement for draws of blocks; `totals` are the frames of each draw."""

    def __init__(
        self,
        placement: Placement,
        roi: Roi,
        surrogates: Collection[str],
        sensing: Sensing,
        draws: NDArray[np.int64],
        totals: NDArray[np.int64],
    ) -> None:
        self._placement, self._roi, self._surrogates = placement, roi, surrogates
        self._sensing, self._draws, self._totals = sensing, draws, totals
        every = ((name, SURROGATES[name].of_seen) for name in (*POG_SURROGATES.own, *surrogates))
        self._computed = {name: of_seen for name, of_seen in every if of_seen is not None}
        self._covered = coverage(placement, roi, sensing.method).reshape(-1)
        self._rays = ray_counts(placement, roi, rays_of(sensing.method)).reshape(-1)
        self._all_covered = CoveredVoxels(partial(int, np.count_nonzero(self._covered)))

    def values(self, histories: BlockCounts) -> dict[str, list[float]]:
        """Return each surrogate of a class by draw."""
        occupied = histories.voxels
        log_misses = self._log_misses(histories) if self._sensing.occlusion else None
        voxels = _by_history(histories, np.ones(len(occupied), np.int64))
        covered = _by_history(histories, self._covered[occupied])
        crossings_of = _crossings_of(histories, self._rays[occupied])
        log_miss_of_one = log_miss_of_ray(self._sensing.detection_probability)
        values: dict[str, list[float]] = {name: [] for name in self._surrogates}
        for draw, total in zip(self._draws, self._totals.tolist(), strict=True):
            counts = histories.counts(draw)
            levels = np.arange(1, int(counts.max()) + 1)
            of_level = np.bincount(counts, voxels)[1:]
            entropy = entropy_of_counts(levels, total)
            crossings = crossings_of(counts)
            gain = partial(expected_ig, total, crossings, log_miss_of_one)
            if log_misses is not None:
                gain = partial(_gain, counts[histories.history], total, log_misses)
            inputs = SurrogateInputs(
                frames=total,
                counts=levels,
                voxels=of_level,
                covered=np.bincount(counts, covered)[1:],
                entropy=entropy,
                h_pog=math.fsum(of_level * entropy),
                crossings=partial(crossings_of, counts),
                points=partial(expected_points, total, crossings, 1.0),
                information=gain,
            )
            result = self._result(inputs)
            for name in self._surrogates:
                values[name].append(result.asked(name))
        return values

    def _log_misses(self, histories: BlockCounts) -> NDArray[np.float64]:
        """Return ln(1 - d) of every occupied voxel, with the POG of all frames."""
        counts = np.zeros(self._covered.size, np.int32)
        counts[histories.voxels] = histories.counts(self._draws[0])[histories.history]
        log = counts.reshape(self._roi.shape), int(self._totals[0])
        method, q = rays_of(self._sensing.method), self._sensing.detection_probability
        return log_miss(self._placement, self._roi, method, *log, q).reshape(-1)[histories.voxels]

    def _result(self, inputs: SurrogateInputs) -> Surrogates:
        """Return all surrogates of one draw."""
        rig, roi, method = f"placement {self._placement.name}", self._roi, self._sensing.method
        numbers = {
            name: SURROGATES.number(name, partial(compute, inputs), rig)
            for name, compute in self._computed.items()
        }
        nonzero, covered = int(inputs.covered.sum()), self._all_covered
        return Surrogates(self._placement, roi, method, numbers, covered, nonzero, seconds=0.0)


def frame_blocks(frames: pd.DataFrame, blocks: int) -> NDArray[np.int64]:
    """Return the block of every row of the frames table: consecutive frames of one route.

    A route gives blocks by its share of the frames, at least one, of equal length up to a frame; so
    their number is about `blocks`. Without a column `route` (or `scene`) the log is one route.
    Raises ValueError without a column `frame`, frames or blocks."""
    if "frame" not in frames.columns:
        raise InputError(key="frames", expected="a column frame", found=list(frames.columns))
    if blocks < 1 or not len(frames):
        counts = f"{blocks} and {len(frames)}"
        raise InputError(expected="at least 1 block and 1 frame", found=counts)
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
