"""Reliability and the noise of seeds: scipy, published values, populations that are known."""

import numpy as np
import pytest
from scipy import stats

from tracking.statistics.reliability import (
    Noise,
    pooled_variance,
    reliability,
    reliability_of_mean,
    seed_mean,
    without_seeds,
)

RATINGS = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7.0]]
)
"""Shrout and Fleiss (1979), table 2: six targets, four judges."""


def of_means(y):
    noise = Noise.of(y)
    return reliability(seed_mean(y), noise.of_mean, noise.degrees)


def test_published_icc_3_of_the_same_judges():
    """ICC(3, 1) is 0.71, ICC(3, 4) 0.91, and its interval by the F distribution."""
    value, low, high = of_means(RATINGS)
    assert value == pytest.approx(0.91, abs=0.005)
    assert reliability_of_mean(value, 1 / 4) == pytest.approx(0.71, abs=0.005)
    assert (low, high) == pytest.approx((0.68, 0.99), abs=0.005)


def test_published_icc_1_of_other_judges():
    """ICC(1, 1) is 0.17, ICC(1, 4) 0.44: each target has judges of its own."""
    y = np.full((6, 24), np.nan)
    for i, row in enumerate(RATINGS):
        y[i, 4 * i : 4 * i + 4] = row
    value = of_means(y)[0]
    assert value == pytest.approx(0.44, abs=0.005)
    assert reliability_of_mean(value, 1 / 4) == pytest.approx(0.17, abs=0.005)


def test_what_a_seed_adds_to_all_placements_is_no_noise():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(7, 1)) + rng.normal(size=(7, 4))
    shifted = y + np.array([100.0, -3.0, 0.0, 40.0])
    plain, large = Noise.of(y), Noise.of(shifted)
    assert large.variance == pytest.approx(plain.variance)
    assert (plain.degrees, large.degrees) == (18, 18)
    # Two placements: the paired t test's variance of the difference is twice that of one.
    pair = Noise.of(shifted[:2])
    assert 2 * pair.variance == pytest.approx(np.var(shifted[0] - shifted[1], ddof=1))
    assert large.seed_sd > 40 > plain.seed_sd


def test_the_seed_s_own_spread_is_estimated_without_bias():
    rng = np.random.default_rng(1)
    estimates = []
    for _ in range(2000):
        y = 2 * rng.normal(size=(1, 3)) + rng.normal(size=(24, 3)) + rng.normal(size=(24, 1))
        estimates.append(Noise.of(y).seed_sd ** 2)
    assert np.mean(estimates) == pytest.approx(4, rel=0.1)


def test_other_seeds_under_some_placements_are_not_paired():
    y = np.array([[1.0, 2.0, np.nan], [5.0, np.nan, 7.0]])
    noise = Noise.of(y)
    assert (noise.variance, noise.degrees) == pytest.approx((stats.tvar([1, 2]) / 2 + 1, 2))
    assert np.isnan(noise.seed_sd)
    assert Noise.of_each(y).degrees == 2


@pytest.mark.parametrize(("seed_sd", "covered"), [(0.0, 0.95), (1.0, 0.94), (3.0, 0.92)])
def test_the_mean_s_own_interval_holds_it_whatever_the_seeds_add(seed_sd, covered):
    """With the degrees of freedom of independent seeds it would be 86 % for an effect of 3."""
    rng, held, times = np.random.default_rng(2), [], 1500
    for _ in range(times):
        y = seed_sd * rng.normal(size=(1, 3)) + rng.normal(size=(24, 3))
        noise = Noise.of_each(y)
        half = stats.t.ppf(0.975, noise.degrees) * np.sqrt(noise.variance / 3)
        held.append((np.abs(y.mean(axis=1)) < half).mean())
    assert np.mean(held) == pytest.approx(covered, abs=0.015)


def test_many_samples_at_once_are_each_by_itself():
    y = np.random.default_rng(3).normal(size=(5, 4, 3))
    y[1, 0, 0] = np.nan
    _, variance, degrees = without_seeds(y)
    for i in range(5):
        alone = without_seeds(y[i])[1:]
        assert (variance[i], degrees[i]) == pytest.approx((float(alone[0]), float(alone[1])))
    assert (degrees[0], degrees[1]) == (6, 5)


def test_missing_trainings_are_left_out_of_a_fit_by_least_squares():
    rng = np.random.default_rng(4)
    y = rng.normal(size=(6, 4)) + np.array([50.0, 0, -20, 7])
    y[[0, 2, 2, 5], [0, 1, 3, 3]] = np.nan
    row, seed = np.nonzero(np.isfinite(y))
    design = np.column_stack([np.eye(6)[row], np.eye(4)[seed][:, 1:] - 1 / 4])
    fit, squares = np.linalg.lstsq(design, y[row, seed])[:2]
    # An unknown constant of the seeds is in all means alike.
    means, variance, degrees = without_seeds(np.insert(y, 2, np.nan, axis=1))
    assert means - means.mean() == pytest.approx(fit[:6] - fit[:6].mean())
    assert (variance, degrees) == pytest.approx((squares[0] / 11, 11))
    apart = np.array([[1.0, 2, np.nan, np.nan], [np.nan, np.nan, 5, 7]])  # no seed in common
    assert without_seeds(apart)[0] == pytest.approx(seed_mean(apart))
    assert tuple(map(float, without_seeds(apart)[1:])) == (1.25, 2)


def test_unequal_seeds_recover_the_share_of_variance():
    rng = np.random.default_rng(1)
    y = rng.normal(size=(400, 60, 1)) + 0.5 * rng.normal(size=(400, 60, 3))
    y[:, ::2, 2] = np.nan
    assert np.mean(pooled_variance(y)[0]) == pytest.approx(0.25, rel=0.01)
    estimates = [of_means(one)[0] for one in y]
    assert np.mean(estimates) == pytest.approx(1 / (1 + 0.25 * (1 / 3 + 1 / 2) / 2), abs=0.01)


def test_stiff_cases():
    assert np.isnan(of_means(np.arange(5.0)[:, None])).all()
    assert np.isnan(of_means(np.ones((4, 3)))).all()
    assert np.isnan(of_means(np.array([[1.0, 2.0]]))).all()
    assert of_means(np.array([[1.0, 2.0], [2.1, 1.0]]))[0] == 0
    assert of_means(np.array([[1.0, 1.0], [2.0, 2.0]]))[0] == 1
    huge = np.array([[1e150, 2e150, 0], [0, 3e150, 1e150]])
    assert np.isfinite(Noise.of(huge / 1e145).variance)
    partly = np.array([[np.nan, 3.0], [np.nan, np.nan]])
    assert seed_mean(partly) == pytest.approx([3.0, np.nan], nan_ok=True)
