"""Intervals of correlations: against scipy, published formulas, and populations that are known."""

import numpy as np
import pytest
from scipy import stats

from tracking.statistics.coefficients import COEFFICIENTS, scores
from tracking.statistics.confidence_interval import corrected, intervals

TRUTH = {
    "pearson": lambda rho: rho,
    "spearman": lambda rho: 6 / np.pi * np.arcsin(rho / 2),
    "kendall": lambda rho: 2 / np.pi * np.arcsin(rho),
}


def normal_samples(rho, n, seeds, noise, times):
    rng = np.random.default_rng(5)
    x, e = rng.standard_normal((2, times, n))
    mu = rho * x + np.sqrt(1 - rho**2) * e
    return x, mu[..., None] + noise * rng.standard_normal((times, n, seeds))


def test_pearson_is_scipys_interval_where_tails_are_light_and_wider_for_an_outlier():
    x = np.linspace(-1, 1, 12)
    y = x + 0.4 * np.cos(5 * np.arange(12))
    low, high = intervals(x, y[:, None], "pearson")
    theirs = stats.pearsonr(x, y).confidence_interval(0.95)
    assert (low, high) == pytest.approx((theirs.low, theirs.high), rel=1e-9)
    x = np.append(np.linspace(-1, 1, 19), 8.0)
    y = np.append(np.cos(7 * np.arange(19)), 8.0)
    low, high = intervals(x, y[:, None], "pearson")
    theirs = stats.pearsonr(x, y).confidence_interval(0.95)
    assert high - low > 1.5 * (theirs.high - theirs.low)


def test_spearman_is_bonett_and_wrights_interval():
    x = np.arange(12.0)
    y = np.array([2, 1, 4, 3, 7, 5, 6, 11, 8, 12, 9, 10.0])
    rho = stats.spearmanr(x, y).statistic
    half = stats.norm.ppf(0.975) * np.sqrt((1 + rho**2 / 2) / 9)
    expected = np.tanh(np.arctanh(rho) + np.array([-half, half]))
    assert intervals(x, y[:, None], "spearman") == pytest.approx(expected)


def test_kendalls_width_is_that_of_its_distribution():
    """Without correlation tau's variance is 2 (2 n + 5) / (9 n (n - 1))."""
    x = np.arange(9.0)
    y = np.array([4, 8, 0, 5, 1, 7, 2, 6, 3.0])
    tau = stats.kendalltau(x, y).statistic
    assert abs(tau) < 0.2
    low, high = np.arctanh(intervals(x, y[:, None], "kendall"))
    assert (low + high) / 2 == pytest.approx(np.arctanh(tau))
    error = np.sqrt(2 * (2 * 9 + 5) / (9 * 9 * 8))
    assert (high - low) / 2 == pytest.approx(1.96 * error, rel=1e-3)


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
@pytest.mark.parametrize(("n", "rho"), [(6, 0.5), (8, 0.9), (12, -0.95), (20, 0.0)])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_coverage_in_normal_populations(coefficient, n, rho, noise):
    x, y = normal_samples(rho, n, 3, noise, times=1500)
    low, high = intervals(x, y, coefficient).T
    true = TRUTH[coefficient](rho)
    covered = np.mean((low <= true) & (true <= high))
    # 95 % within 2.5 points, and three standard errors of 1,500 samples (0.56 points each); tau
    # and rho of few placements take few values, and cover more than they should.
    assert covered >= 0.925 - 0.017
    assert covered <= (0.975 + 0.012 if coefficient == "pearson" else 1.0)


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
def test_heavy_noise_of_seeds_is_corrected_for(coefficient):
    """Two seeds with as much noise as placements differ: the raw coefficient is far too small."""
    x, y = normal_samples(0.9, 20, 2, 1.0, times=1000)
    true = TRUTH[coefficient](0.9)
    covered = []
    for metric in (y, y.mean(axis=-1, keepdims=True)):
        low, high = intervals(x, metric, coefficient).T
        covered.append(np.mean((low <= true) & (true <= high)))
    assert covered[0] > 0.91
    assert covered[1] < 0.75


@pytest.mark.parametrize("rho", [0.5, 0.8, 0.9])
@pytest.mark.parametrize("n", [8, 24])
@pytest.mark.parametrize("effect", [0.0, 1.0, 3.0])
def test_coverage_whatever_seeds_add_to_all_placements(rho, n, effect):
    """93 to 97 %, with three standard errors of 1,500 samples (0.5 points each)."""
    x, y = normal_samples(2 * np.sin(np.pi * rho / 6), n, 3, 0.5, times=1500)
    y = y + 0.5 * effect * np.random.default_rng(1).normal(size=(1500, 1, 3))
    low, high = intervals(x, y, "spearman").T
    assert np.mean((low <= rho) & (rho <= high)) == pytest.approx(0.95, abs=0.02 + 0.015)


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
def test_an_interval_holds_its_estimates_and_is_no_point(coefficient, noise):
    """Also where chance makes the means look hardly reliable: the bounds do not meet at 1."""
    x, y = normal_samples(0.9, 10, 2, noise, times=1000)
    low, high = intervals(x, y, coefficient).T
    estimates = (scores(x, coefficient) * scores(y.mean(axis=-1), coefficient)).sum(axis=-1)
    freed = corrected(estimates[:, None], y, coefficient)[:, 0]
    for estimate in (estimates, freed):
        assert ((low <= estimate + 1e-12) & (estimate <= high + 1e-12)).all()
    assert np.max(low) < 1 - 1e-4


@pytest.mark.parametrize("coefficient", ["spearman", "kendall"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_perfect_order_still_has_an_interval(coefficient, sign):
    x = np.arange(6.0)
    low, high = sorted(sign * intervals(x, (sign * np.exp(x))[:, None], coefficient))
    assert high == 1.0
    assert 0 < low < 0.9


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
def test_stiff_cases(coefficient):
    x, y = np.arange(3.0), np.arange(3.0)[:, None]
    assert np.isnan(intervals(x, y, coefficient)).all()
    assert np.isnan(intervals(np.ones(6), np.arange(6.0)[:, None], coefficient)).all()
    rng = np.random.default_rng(0)
    tied, y = rng.integers(0, 2, 8).astype(float), rng.normal(size=(8, 3))
    y[0, 1:] = np.nan
    low, high = intervals(tied, y, coefficient)
    assert -1 <= low < high <= 1
    assert intervals(-tied, y, coefficient) == pytest.approx([-high, -low])
    noise = rng.normal(size=(8, 2))
    noise -= noise.mean(axis=1, keepdims=True) * 0.999  # hardly anything but noise
    assert np.isfinite(intervals(tied, noise, coefficient)).all()
