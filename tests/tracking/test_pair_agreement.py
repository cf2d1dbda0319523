"""Pairs that differ by more than noise, and how many a predictor orders rightly, by brute force."""

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.pair_agreement import pair_agreement
from tracking.statistics.reliability import Noise, seed_mean


def test_every_pair_is_looked_at_by_itself():
    random = np.random.default_rng(3)
    y = random.normal(size=(9, 1)) + 0.4 * random.normal(size=(9, 3))
    values = np.round(y.mean(axis=1) + random.normal(size=9), 0)  # with ties
    means, noise = seed_mean(y), Noise.of(y)

    right, number = 0.0, 0
    for one, two in combinations(range(9), 2):
        error = np.sqrt(2 * noise.variance / 3)
        if abs(means[one] - means[two]) <= stats.t.ppf(0.975, noise.degrees) * error:
            continue
        number += 1
        if values[one] == values[two]:
            right += 0.5
        elif (values[one] > values[two]) == (means[one] > means[two]):
            right += 1
    assert 5 < number < 36

    found = pair_agreement(values, AllPairs.of(means, noise))

    assert found == (pytest.approx(right / number), number)


def test_nothing_is_known_of_one_seed():
    y = np.arange(5.0)[:, None]
    share, number = pair_agreement(np.arange(5.0), AllPairs.of(y[:, 0], Noise.of(y)))
    assert np.isnan(share)
    assert number == 0
