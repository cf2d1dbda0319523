"""Pearson's r, Spearman's rho and Kendall's tau as inner products of unit vectors."""

import numpy as np
from numpy.typing import NDArray
from scipy import stats

COEFFICIENTS = ("pearson", "spearman", "kendall")


def scores(values: NDArray[np.float64], coefficient: str) -> NDArray[np.float64]:
    """Unit vectors whose inner product is the coefficient of two samples.

    - `pearson`: the centred values;
    - `spearman`: the centred ranks, ties share their mean rank;
    - `kendall`: the signs of all differences `values[j] - values[i]`, i < j, which makes the inner
      product tau-b (Kendall 1945): ties lower the length of the vector.

    One form for all three, so that permutations and resamples are matrix products.

    Args:
        values: samples along the last axis, shape (..., n).
        coefficient: one of `COEFFICIENTS`.

    Returns:
        Shape (..., n), or (..., n (n - 1) / 2) for `kendall`. NaN where a sample is constant.

    Raises:
        ValueError: `coefficient` is not known.
    """
    if coefficient == "kendall":
        i, j = np.triu_indices(values.shape[-1], 1)
        vectors = np.sign(values[..., j] - values[..., i])
        rounding = np.zeros(vectors.shape[:-1])
    elif coefficient in COEFFICIENTS:
        # Numbers near 1e300 or 1e-300 have no squares: the largest becomes 1.
        peak = np.abs(values).max(axis=-1, keepdims=True)
        scaled = values / np.where(peak > 0, peak, 1.0)
        sample = stats.rankdata(values, axis=-1) if coefficient == "spearman" else scaled
        vectors = sample - sample.mean(axis=-1, keepdims=True)
        # The mean of equal numbers may be off by a rounding: such a rest is no spread.
        rounding = 1e-13 * np.abs(sample).sum(axis=-1)
    else:
        raise ValueError(f"coefficient must be one of {COEFFICIENTS}, found {coefficient!r}")
    length = np.linalg.norm(vectors, axis=-1)
    length = np.where(length > rounding, length, np.nan)
    return vectors / length[..., None]
