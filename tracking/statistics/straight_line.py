"""Predict a metric by a straight line of a surrogate, leaving one placement out at a time."""

import numpy as np
from numpy.typing import NDArray


def best_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[int, float, float]:
    """The column of `x` whose least-squares line leaves the smallest residual of `y`.

    Args:
        x: shape (n, k).
        y: shape (n,).

    Returns:
        The column, and slope and intercept of its line. A constant column predicts the mean.
    """
    centred = x - x.mean(axis=0)
    spread = (centred**2).sum(axis=0)
    slope = (centred.T @ (y - y.mean())) / np.where(spread > 0, spread, 1.0)
    residual = ((y - y.mean())[:, None] - slope * centred) ** 2
    best = int(np.argmin(residual.sum(axis=0)))
    return best, float(slope[best]), float(y.mean() - slope[best] * x[:, best].mean())


def left_out_predictions(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Each value of `y` from `best_line` through the others.

    Args:
        x: shape (n, k).
        y: shape (n,).

    Returns:
        The predictions, and the columns that the others chose, both shape (n,).
    """
    # Numbers near 1e300 or 1e-300 have no squares: the largest of a column becomes 1.
    peak = np.abs(x).max(axis=0)
    scaled = x / np.where(peak > 0, peak, 1.0)
    predictions, columns = np.empty(len(y)), np.empty(len(y), dtype=np.intp)
    for i in range(len(y)):
        others = np.arange(len(y)) != i
        columns[i], slope, intercept = best_line(scaled[others], y[others])
        predictions[i] = intercept + slope * scaled[i, columns[i]]
    return predictions, columns


def left_out_means(y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each value of `y` as the mean of the others, shape (n,)."""
    return np.asarray((y.sum() - y) / (len(y) - 1))


def rmse(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Root of the mean squared difference."""
    return float(np.sqrt(np.mean((found - expected) ** 2)))
