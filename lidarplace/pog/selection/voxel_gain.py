"""Gain of a voxel by its exposure to rays: a concave function that starts at 0.

Exposures of candidates add up, so the value of a set is `sum over v of g_v(exposure of v)`, and
monotone and submodular because every g_v is concave and does not fall."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner
from lidarplace.pog.occupancy.entropy import entropy_of_counts
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.formulas import information_at

Shape = Literal["cover", "information", "linear"]
COVER, INFORMATION, LINEAR = 0, 1, 2
_CODES: dict[Shape, int] = {"cover": COVER, "information": INFORMATION, "linear": LINEAR}
SATURATED = 750.0
"""An exposure in nats that is as good as infinite: `exp(-750)` is 0 in float64."""


@dataclass(frozen=True, eq=False)
class VoxelGain:
    """g_v of voxels; those that are occupied equally often in each class share a profile.

    By `shape` it is `cover`, `worth * min(1, m)`; `linear`, `worth * m`; or `information`, the sum
    over the classes of `weight * I(p, m)` with `m = -ln(1 - d)`, see `surrogate.expected_ig`.
    `profile` is that of every voxel, shape (voxels,); `worth`, nats, or objects a frame, is by
    profile, `p` and what is left of 1, `rest`, are by profile and class, `weights` by class."""

    shape: Shape
    profile: NDArray[np.int32]
    worth: NDArray[np.float64]
    p: NDArray[np.float64]
    rest: NDArray[np.float64]
    weights: NDArray[np.float64]

    @classmethod
    def of_voxels(
        cls,
        shape: Shape,
        grids: Mapping[str, OccupancyGrid],
        weights: Mapping[str, float],
        counts: NDArray[np.int32],
    ) -> VoxelGain:
        """Return gains by the counts of each class in the voxels, shape (classes, voxels)."""
        profile, of_profile = _profiles(counts)
        frames = np.array([grid.frames for grid in grids.values()])
        weight = np.array([weights.get(name, 0) for name in grids], np.float64)
        p, rest = of_profile / frames, (frames - of_profile) / frames
        each = zip(of_profile.T, frames.tolist(), strict=True)
        entropy = [entropy_of_counts(counts_of_class, number) for counts_of_class, number in each]
        worth = p @ weight if shape == "linear" else np.stack(entropy, axis=1) @ weight
        return cls(shape, profile, worth, p, rest, weight)

    @property
    def tables(self) -> tuple[Any, ...]:
        """Arguments of the compiled functions."""
        return _CODES[self.shape], self.profile, self.worth, self.p, self.rest, self.weights


def _profiles(counts: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the profile of every voxel, and the counts of a profile, shape (profiles, classes)."""
    profile = np.zeros(counts.shape[1], np.int64)
    for row in counts:
        values, place = np.unique(row, return_inverse=True)
        _, profile = np.unique(profile * max(1, len(values)) + place, return_inverse=True)
    _, first = np.unique(profile, return_index=True)
    return profile.astype(np.int32), counts[:, first].T


@inner
def gain_at(tables, v, m):
    """Return g_v(m)."""
    shape, profile, worth, p, rest, weights = tables
    a = profile[v]
    if shape == COVER:
        return worth[a] * min(1.0, m)
    if shape == LINEAR:
        return worth[a] * m
    total = 0.0
    if m > 0:
        for c in range(len(weights)):
            if p[a, c] > 0:
                total += weights[c] * information_at(p[a, c], rest[a, c], -m)
    return total


@inner
def slope_at(tables, v, m):
    """Return a slope s with `g_v(m) + s (t - m) >= g_v(t)` for all t."""
    shape, profile, worth, p, rest, weights = tables
    a = profile[v]
    if shape == COVER:
        return worth[a] if m < 1 else 0.0
    if shape == LINEAR:
        return worth[a]
    total, miss = 0.0, math.exp(-m)
    if miss > 1e-300:
        for c in range(len(weights)):
            if p[a, c] > 0:
                missed = p[a, c] * miss  # dI/dm = p (1 - d) ln(1 + (1 - p) / (p (1 - d)))
                total += weights[c] * missed * math.log1p(rest[a, c] / missed)
    return total
