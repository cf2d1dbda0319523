"""The binary entropy, from both probabilities."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import njit


def binary_entropy(p: ArrayLike, rest: ArrayLike) -> NDArray[np.float64]:
    """Return `H = -p ln p - (1-p) ln(1-p)` in nats, 0 at p = 0 and p = 1.

    `rest` is 1 - p, of equal shape, float64, rounded on its own: a float near 1 does not know its
    distance to 1, on which H depends. So the result is exact to one or two units in the last place.
    Raises ValueError for NaN, a number outside [0, 1], or a pair whose sum is not 1."""
    p, rest = np.broadcast_arrays(np.asarray(p, np.float64), np.asarray(rest, np.float64))
    entropy = np.empty(p.shape)
    bad = _binary_entropy(p.reshape(-1), rest.reshape(-1), entropy.reshape(-1))
    if bad >= 0:
        values = f"{p.reshape(-1)[bad]} and {rest.reshape(-1)[bad]}"
        raise InputError("p and 1 - p must be within [0, 1] and add up to 1", found=values)
    return entropy


def entropy_of_counts(counts: NDArray[np.integer], frames: int) -> NDArray[np.float64]:
    """Return H in nats of voxels that are occupied in `counts` of `frames` frames, same shape."""
    return binary_entropy(counts / frames, (frames - counts) / frames)


@njit(cache=True)
def _binary_entropy(p, rest, entropy):
    """Fill `entropy`; returns the index of the first pair that is not a probability, or -1."""
    for i in range(len(p)):
        small, large = min(p[i], rest[i]), max(p[i], rest[i])
        # Rounding moves the sum by 2e-16 at most; NaN fails the last comparison.
        if small < 0 or large > 1 or not abs(p[i] + rest[i] - 1) <= 1e-15:
            return i
        entropy[i] = -small * math.log(small) - large * math.log1p(-small) if small > 0 else 0.0
    return -1
