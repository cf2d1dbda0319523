"""Prediction of a metric by a straight line of a surrogate, each placement left out in turn."""

import numpy as np

from tracking.statistics import Values


def left_out_predictions(x: Values, y: Values) -> Values:
    """Predict each value of `y` by the least-squares line of `x` through the others; shapes (n,).

    A constant predicts the mean of the others."""
    # Numbers near 1e300 or 1e-300 have no squares: the largest becomes 1.
    scaled = x / (np.abs(x).max() or 1.0)
    predictions = np.empty(len(y))
    for i in range(len(y)):
        others, metric = np.delete(scaled, i), np.delete(y, i)
        centred = others - others.mean()
        slope = centred @ (metric - metric.mean()) / ((centred @ centred) or 1.0)
        predictions[i] = metric.mean() + slope * (scaled[i] - others.mean())
    return predictions


def left_out_means(y: Values) -> Values:
    """Predict each value of `y` by the mean of the others, shape (n,)."""
    return np.asarray((y.sum() - y) / (len(y) - 1))


def rmse(predicted: Values, expected: Values) -> float:
    """Compute the root of the mean squared difference."""
    return float(np.sqrt(np.mean((predicted - expected) ** 2)))
