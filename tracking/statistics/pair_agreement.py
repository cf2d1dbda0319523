"""How often does a predictor put two placements in the order of their metric?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.all_pairs import AllPairs


def pair_agreement(values: NDArray[np.float64], pairs: AllPairs) -> tuple[float, int]:
    """Share of the pairs that a predictor orders as their means, and the number of these pairs.

    Those count of which the 95 % interval of their own difference, by Student's distribution,
    leaves out zero. Where the predictor gives both the same value it is right by half.

    Args:
        values: of the placements, in the order of `pairs`, high for good ones, shape (n,).
        pairs: their means, and how the differences scatter; NaN and 0 where that is unknown.
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
