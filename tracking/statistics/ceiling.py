"""What a perfect predictor of a noisy metric would reach: the ceiling of a correlation."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracking.statistics.confidence_interval import from_normal


def ceiling(reliable: ArrayLike, coefficient: str = "spearman") -> NDArray[np.float64]:
    """The coefficient of a metric of this reliability with what predicts it perfectly.

    Noise lowers a correlation by the root of the product of both reliabilities (attenuation,
    Spearman 1904), and a perfect predictor has neither noise nor error: sqrt(reliability), on the
    scale of a normal population's Pearson correlation, from where it becomes the coefficient's.
    It is what is expected: by luck a sample may exceed it.

    Args:
        reliable: in [0, 1], of any shape.

    Returns:
        The same shape, in [0, 1].
    """
    return np.asarray(from_normal(np.sqrt(np.asarray(reliable, np.float64)), coefficient))
