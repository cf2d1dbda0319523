"""How much of a metric's spread lies between placements, and how much is the seeds' noise?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Noise:
    """How means over seeds scatter: the variance of a mean is `variance / counts`.

    Attributes:
        counts: seeds of every placement, shape (n,).
        variance: over seeds within placements, pooled; NaN without degrees of freedom.
        degrees: its degrees of freedom.
    """

    counts: NDArray[np.float64]
    variance: float
    degrees: float

    @classmethod
    def of_seeds(cls, y: NDArray[np.float64]) -> Noise:
        """Of values of shape (n, seeds), NaN where a seed is missing."""
        pooled, degrees = pooled_variance(y)
        counts = np.isfinite(y).sum(axis=1).astype(np.float64)
        return cls(counts, float(pooled), float(degrees))

    @classmethod
    def of(cls, y: NDArray[np.float64], shared: bool) -> Noise:
        """`of_judges` if seeds are `shared` and none is missing, else `of_seeds`."""
        return cls.of_judges(y) if shared and np.isfinite(y).all() else cls.of_seeds(y)

    @classmethod
    def of_judges(cls, y: NDArray[np.float64]) -> Noise:
        """Of values of shape (n, judges), where each judge has judged all placements.

        What a judge gives to all placements alike makes none of them better: it is taken out, as in
        a two-way analysis of variance without repetition (Fisher 1925). A missing value raises
        ValueError.
        """
        if not np.isfinite(y).all():
            raise ValueError("every judge must have judged every placement, found a missing value")
        placements, judges = y.shape
        rest = y - y.mean(axis=0) - y.mean(axis=1, keepdims=True) + y.mean()
        degrees = (placements - 1) * (judges - 1)
        variance = float((rest**2).sum() / degrees) if degrees else float("nan")
        return cls(np.full(placements, float(judges)), variance, float(degrees))


def pooled_variance(y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Variance over seeds within placements, pooled over placements.

    Args:
        y: one row a placement, one column a seed, shape (..., n, seeds). NaN where a seed is
            missing.

    Returns:
        The variance and its degrees of freedom, shape (...,). NaN without degrees of freedom.
    """
    counts = np.isfinite(y).sum(axis=-1)
    degrees = np.maximum(counts - 1, 0).sum(axis=-1)
    deviations = y - seed_mean(y)[..., None]
    total = np.nansum(deviations**2, axis=(-2, -1))
    return np.where(degrees > 0, total / np.maximum(degrees, 1), np.nan), degrees


def seed_mean(y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the seeds that are there, shape (..., n); NaN where none is."""
    counts = np.isfinite(y).sum(axis=-1)
    return np.where(counts > 0, np.nansum(y, axis=-1) / np.maximum(counts, 1), np.nan)


def icc(y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intraclass correlation ICC(1) of one seed: between / (between + within) variance.

    From the one-way analysis of variance (Shrout and Fleiss 1979); for unequal numbers of seeds
    with the usual mean number. An estimate below 0 is reported as 0.

    Args:
        y: as in `pooled_variance`, a number in every row.

    Returns:
        Shape (...,), in [0, 1]. NaN with one seed everywhere, one placement, or no spread at all.
    """
    within, _ = pooled_variance(y)
    counts = np.isfinite(y).sum(axis=-1)
    n, total = counts.shape[-1], counts.sum(axis=-1)
    if n < 2:
        return np.full(total.shape, np.nan)
    grand = np.nansum(y, axis=(-2, -1)) / total
    square = (counts * (seed_mean(y) - grand[..., None]) ** 2).sum(axis=-1) / (n - 1)
    seeds = (total - (counts**2).sum(axis=-1) / total) / (n - 1)
    between = np.maximum(square - within, 0.0) / seeds
    whole = between + within
    return np.where(whole > 0, between / np.where(whole > 0, whole, 1.0), np.nan)


def reliability_of_mean(single: ArrayLike, seeds: ArrayLike) -> NDArray[np.float64]:
    """Reliability of a mean over seeds from that of one seed (Spearman 1910, Brown 1910)."""
    one, s = np.asarray(single, np.float64), np.asarray(seeds, np.float64)
    return s * one / (1 + (s - 1) * one)
