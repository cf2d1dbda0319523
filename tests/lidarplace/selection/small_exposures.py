"""Small cases of every shape of gain, and the best of all their subsets."""

import itertools

import numpy as np
from hypothesis import strategies as st

from lidarplace.pog.selection import Exposure, Limits, VoxelChoice
from lidarplace.pog.selection.voxel_gain import VoxelGain

SHAPES = ("cover", "information", "linear")
VOXELS = 8


def exposure_of(amounts, shape, worth=None, p=None, scale=0.7):
    """From a dense matrix of amounts, shape (candidates, voxels)."""
    amounts = np.asarray(amounts, np.float32)
    voxels = amounts.shape[1]
    worth = np.ones(voxels) if worth is None else np.asarray(worth, float)
    p = np.full(voxels, 0.3) if p is None else np.asarray(p, float)
    if shape == "cover":
        amounts, scale = np.minimum(amounts, 1), 1.0
    rows, columns = np.nonzero(amounts)
    offsets = np.concatenate([[0], np.cumsum((amounts > 0).sum(axis=1))]).astype(np.int64)
    profile, one = np.arange(voxels, dtype=np.int32), np.ones(1)
    gain = VoxelGain(shape, profile, worth, p[:, None], 1 - p[:, None], one)
    scales = np.full(len(amounts), float(scale))
    return Exposure(offsets, columns.astype(np.uint32), amounts[rows, columns], scales, gain)


def greedy(exposure, limits):
    return VoxelChoice(exposure).greedy(limits)


def upper_bound(exposure, limits, chosen=(), **options):
    return VoxelChoice(exposure).upper_bound(limits, chosen, **options)


def feasible_sets(limits):
    """All of them, by trying."""
    numbers = range(limits.candidates)
    for size in range(limits.candidates + 1):
        for chosen in itertools.combinations(numbers, size):
            if (limits.used[:, list(chosen)].sum(axis=1) > limits.budgets + 1e-9).any():
                continue
            pairs = itertools.combinations(chosen, 2)
            if limits.compatible is None or all(limits.compatible[a, b] for a, b in pairs):
                yield chosen


def best_of_all(exposure, limits):
    return max(exposure.value(chosen) for chosen in feasible_sets(limits))


@st.composite
def exposures(draw, most=7):
    seed, candidates = draw(st.integers(0, 2**32 - 1)), draw(st.integers(0, most))
    shape = draw(st.sampled_from(SHAPES))
    rng = np.random.default_rng(seed)
    some = rng.random((candidates, VOXELS)) < draw(st.sampled_from([0.15, 0.4, 0.9]))
    amounts = some * rng.integers(1, draw(st.sampled_from([2, 4, 40])), (candidates, VOXELS))
    p = rng.choice([1e-6, 0.02, 0.3, 0.5, 0.9, 1.0], VOXELS)
    scale = draw(st.sampled_from([1e-3, 0.1, 0.8, 60.0]))
    return exposure_of(amounts, shape, rng.choice([0.0, 0.3, 1.0, 2.0], VOXELS), p, scale)


@st.composite
def limits_of(draw, candidates):
    """A number of LiDARs, sizes 1 or 2, perhaps prices, perhaps pairs that exclude each other."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    used = [rng.integers(1, 3, candidates)]
    budgets = [float(draw(st.integers(0, 5)))]
    if draw(st.booleans()):
        used.append(rng.choice([0.0, 0.1, 0.3, 5.0], candidates))
        budgets.append(draw(st.sampled_from([0.0, 0.3, 0.6, 9.0])))
    compatible = None
    if draw(st.booleans()):
        apart = rng.random((candidates, candidates)) < 0.6
        compatible = apart & apart.T
    return Limits(np.array(used, float), np.array(budgets), compatible)
