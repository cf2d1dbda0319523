"""Intervals of all pairs: scipy's Tukey test, pairs by hand, and rigs that scatter unequally."""

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from scipy import special, stats

from tracking.statistics.all_pairs import AllPairs, pair_agreement
from tracking.statistics.jackknife import (
    LEAST_OWN_UNITS,
    _inverse_trigamma,
    moderated,
    sample_error,
)
from tracking.statistics.reliability import Noise, seed_mean


def left_out_of(values):
    """Means over routes of equal size without each, from values of shape (routes, placements)."""
    routes, placements = values.shape
    without = (values.sum(axis=0) - values) / (routes - 1)
    table = {
        "placement": np.tile([f"p{i:02}" for i in range(placements)], routes),
        "left_out": np.repeat([f"r{i}" for i in range(routes)], placements),
        "value": without.ravel(),
    }
    return pd.DataFrame(table).assign(seed=1, unit="route", ground_truths=10)


def of_routes(values):
    error = sample_error(left_out_of(values), paired=True)
    none = Noise(np.ones(values.shape[1]), np.nan, 0)
    return AllPairs.of(values.mean(axis=0), none, error, alone=True)


def test_seeds_alone_are_tukeys():
    y = np.random.default_rng(0).normal(size=(4, 5))
    noise = Noise(np.full(4, 5.0), float(y.var(axis=1, ddof=1).mean()), 16)
    pairs = AllPairs.of(y.mean(axis=1), noise)
    theirs = stats.tukey_hsd(*y)
    bounds = theirs.confidence_interval(0.95)
    for at in range(4):
        others = [i for i in range(4) if i != at]
        # The critical value is that of 15 degrees of freedom, the next in the table.
        wider = np.diff(pairs.intervals(at), axis=1)[others, 0]
        exact = (bounds.high - bounds.low)[at][others]
        next_, critical = (stats.studentized_range.ppf(0.95, 4, degrees) for degrees in (15, 16))
        assert wider / exact == pytest.approx(next_ / critical)
        assert pairs.p_of_no_lead(at)[others] == pytest.approx(theirs.pvalue[at][others], abs=1e-6)


def test_few_routes_have_one_variance_for_all_pairs_and_many_their_own():
    rng = np.random.default_rng(1)
    spread = np.array([1.0, 1.0, 6.0, 6.0])
    few, many = (of_routes(spread * rng.normal(size=(n, 4))) for n in (LEAST_OWN_UNITS, 60))
    assert len(np.unique(few.variance[np.triu_indices(4, 1)].round(12))) == 1
    assert many.variance[2, 3] > 10 * many.variance[0, 1]
    assert np.diag(many.variance) == pytest.approx(0)


def test_with_many_routes_two_rigs_are_a_paired_t_test():
    values = np.random.default_rng(2).normal(size=(40, 2)) + np.array([0.0, 0.5])
    low, high = of_routes(values).intervals(0)[1]
    bounds = stats.ttest_rel(*values.T).confidence_interval(0.95)
    assert (low, high) == pytest.approx((bounds.low, bounds.high), rel=1e-9)


@pytest.mark.parametrize("placements", [4, 8])
def test_all_pairs_hold_where_rigs_scatter_unequally(placements):
    """One to three: with one variance for all pairs they are 91 % for eight rigs on 32 routes."""
    rng, held, times = np.random.default_rng(3), 0, 300
    spread = np.linspace(1, 3, placements)
    for _ in range(times):
        pairs = of_routes(spread * rng.normal(size=(32, placements)))
        held += all(
            ((low <= 0) & (high >= 0)).all()
            for low, high in (np.delete(pairs.intervals(i), i, 0).T for i in range(placements))
        )
    assert held / times == pytest.approx(0.95, abs=0.02 + 3 * np.sqrt(0.95 * 0.05 / times))


def test_moderation_recovers_the_prior():
    """Smyth (2004): variances from a scaled inverse chi-square with 10 degrees of freedom."""
    rng = np.random.default_rng(4)
    truth = 3.0 * 10 / rng.chisquare(10, 4000)
    variances, degrees = moderated(truth * rng.chisquare(6, 4000) / 6, 6)
    assert degrees == pytest.approx(16, rel=0.2)
    # The posterior mean of the precision, which no other weighting beats.
    assert np.mean(1 / variances) == pytest.approx(np.mean(1 / truth), rel=0.02)


def test_equal_variances_are_pooled_and_nothing_stays_nothing():
    rng = np.random.default_rng(5)
    variances, degrees = moderated(2 * rng.chisquare(8, 500) / 8, 8)
    assert np.ptp(variances) < 0.1 * variances.mean()
    assert variances.mean() == pytest.approx(2, rel=0.05)
    assert degrees > 100
    assert moderated(np.array([0.0, 4.0]), 5)[0].tolist() == [0, 4]
    some = moderated(np.array([0.0, 4.0, 4.0, 400.0]), 5)[0]
    assert some[0] == 0
    assert 4 < some[1] < some[3] < 400


@pytest.mark.parametrize("value", [1e-8, 1e-3, 0.3, 1.0, 7.0, 1e3, 1e8])
def test_the_inverse_of_trigamma(value):
    assert special.polygamma(1, _inverse_trigamma(value)) == pytest.approx(value, rel=1e-6)


def test_agreement_looks_at_every_pair_by_itself():
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
    agreement = pair_agreement(values, AllPairs.of(means, noise))
    assert agreement == (pytest.approx(right / number), number)


def test_nothing_is_known_of_one_seed():
    y = np.arange(5.0)[:, None]
    pairs = AllPairs.of(y[:, 0], Noise.of(y))
    share, number = pair_agreement(np.arange(5.0), pairs)
    assert np.isnan([share, *pairs.intervals(0).ravel(), *pairs.p_of_no_lead(0)]).all()
    assert number == 0
    alone = AllPairs.of(np.array([1.0]), Noise(np.full(1, 3.0), 1.0, 2))
    assert np.isnan(alone.intervals(0)).all()
