"""A hierarchical bootstrap, to compare with: it is not in use, see docs/statistics.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def hierarchical_resamples(
    y: NDArray[np.float64], resamples: int, seed: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Draw placements with replacement, and for every draw its seeds with replacement.

    Args:
        y: one row a placement, one column a seed, shape (n, seeds). NaN where a seed is missing;
            every row has at least one number.

    Returns:
        The placements drawn, shape (resamples, n), and the mean over the seeds drawn, same shape.
    """
    n, columns = y.shape
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, n, (resamples, n))
    counts = np.isfinite(y).sum(axis=1)
    # Missing seeds go to the end of a row, so that the first counts[i] of row i are numbers.
    packed = np.take_along_axis(y, np.argsort(~np.isfinite(y), axis=1, kind="stable"), axis=1)
    pick = (rng.random((resamples, n, columns)) * counts[drawn][..., None]).astype(np.intp)
    values = packed[drawn[..., None], pick]
    wanted = np.arange(columns) < counts[drawn][..., None]
    return drawn, np.where(wanted, values, 0.0).sum(axis=-1) / counts[drawn]
