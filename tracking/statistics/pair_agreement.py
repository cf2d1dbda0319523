"""How often does a predictor put two placements in the order of their metric?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.all_pairs import AllPairs


def pair_agreement(values: NDArray[np.float64], pairs: AllPairs) -> tuple[float, int]:
    """Share of the pairs that a predictor orders as their means, where these differ by more than
    noise.

    A pair differs by more than noise if the 95 % interval of its own difference, by Student's
    distribution, leaves out zero: of pairs that are equal, one in twenty does. A predictor that
    gives both the same value is right by half.

    Args:
        values: of the placements, in the order of `pairs`, high for good ones, shape (n,).
        pairs: their means, and how the differences scatter.

    Returns:
        The share, NaN without such a pair or with unknown noise, and the number of pairs.
    """
    one, two = np.triu_indices(len(values), 1)
    lead = (pairs.means[one] - pairs.means[two]).astype(np.float64)
    degrees = pairs.degrees[one, two]
    known = degrees > 0
    reach = stats.t.ppf(0.975, np.where(known, degrees, 1.0))
    differ = known & (np.abs(lead) > reach * np.sqrt(pairs.variance[one, two]))
    if not differ.any():
        return float("nan"), 0
    agree = np.sign(values[one] - values[two]) * np.sign(lead)
    return float((1 + agree[differ]).mean() / 2), int(differ.sum())
