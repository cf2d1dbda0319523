"""Leads between surrogates: a published interval, brute force, and populations that are known."""

import numpy as np
import pytest
from scipy import stats

from tracking.statistics.confidence_interval import (
    correlation_of_correlations,
    difference,
    intervals,
    strength_leads,
)


def populations(with_metric, between, n, seeds, times, noise=0.3):
    """Surrogates (times, k, n), the strongest of each sample first, and metrics; their order."""
    k = len(with_metric)
    matrix = np.full((k + 1, k + 1), between)
    matrix[-1, :k] = matrix[:k, -1] = with_metric
    np.fill_diagonal(matrix, 1)
    rng = np.random.default_rng(3)
    drawn = rng.multivariate_normal(np.zeros(k + 1), matrix, (times, n))
    x, y = np.swapaxes(drawn[..., :k], 1, 2), drawn[..., -1:]
    y = y + noise * rng.standard_normal((times, n, seeds))
    ranks = stats.rankdata(x, axis=-1) - (n + 1) / 2
    of_y = stats.rankdata(y.mean(axis=-1), axis=-1) - (n + 1) / 2
    order = np.argsort(-np.abs((ranks * of_y[:, None]).sum(axis=-1)), axis=1)
    return np.take_along_axis(x, order[..., None], axis=1), y, order


def test_zous_example():
    """Zou (2007), page 409: r = 0.396 and 0.179, 0.088 between them, 66 people."""

    def with_bounds(r):
        interval = stats.pearsonr(*_two_samples(r, 66)).confidence_interval(0.95)
        return np.array(r), np.array(interval.low), np.array(interval.high)

    together = correlation_of_correlations(*map(np.array, (0.396, 0.179, 0.088)))
    gap = difference(with_bounds(0.396), with_bounds(0.179), together)
    assert gap == pytest.approx([-0.093, 0.517], abs=5e-4)


def _two_samples(r, n):
    """Samples of which the correlation is exactly r."""
    x = np.linspace(-1, 1, n)
    rest = x**2 - np.mean(x**2)
    x, rest = x / np.linalg.norm(x), rest / np.linalg.norm(rest)
    return x, r * x + np.sqrt(1 - r**2) * rest


@pytest.mark.parametrize(
    ("one", "two", "between"), [(0.5, 0.5, 0.5), (0.8, 0.3, 0.1), (0, 0.6, -0.4)]
)
def test_the_correlation_of_two_correlations_is_that_of_many_samples(one, two, between):
    matrix = [[1, between, one], [between, 1, two], [one, two, 1]]
    products = stats.wishart(100 - 1, matrix).rvs(20_000, random_state=0)  # of deviations
    norms = np.sqrt(np.einsum("tii->ti", products))
    r = products[:, :2, 2] / norms[:, :2] / norms[:, 2:]
    computed = correlation_of_correlations(*map(np.array, (one, two, between)))
    # Four standard errors of 20,000 samples, and as much for 100 being no large sample.
    assert computed == pytest.approx(np.corrcoef(r.T)[0, 1], abs=0.05)


def test_a_perfect_order_has_the_limit():
    """A perfect sample correlation: then the other one is that between the two samples."""
    near, limit = (
        correlation_of_correlations(*map(np.array, (r, 0.4, 0.4))) for r in (1 - 1e-4, 1)
    )
    assert near == pytest.approx(0.2, abs=1e-3)
    assert limit == pytest.approx(near, abs=1e-3)


def test_signs_of_surrogates_do_not_count():
    x, y, _ = populations((0.9, 0.6, 0.3), 0.2, 10, 3, times=20)
    turned = x * np.array([-1, 1, -1])[:, None]
    assert strength_leads(turned, y) == pytest.approx(strength_leads(x, y))


def test_two_surrogates_pay_nothing_for_the_choice_and_five_do():
    x, y, _ = populations((0.7,) * 5, 0.4, 12, 2, times=50)
    pair = strength_leads(x[:, :2], y)
    assert strength_leads(x[:, 1::-1], y) == pytest.approx(-pair[..., ::-1])
    all_five = strength_leads(x, y)[:, :1]
    assert (all_five[..., 0] < pair[..., 0]).all()
    reach = stats.studentized_range.ppf(0.95, 5, np.inf) / np.sqrt(2)
    level = 2 * stats.norm.cdf(reach) - 1
    wide, usual = (intervals(x[0, 0], y[0], "spearman", c) for c in (level, 0.95))
    assert np.ptp(np.arctanh(wide)) > np.ptp(np.arctanh(usual))


@pytest.mark.parametrize("n", [8, 20])
@pytest.mark.parametrize("pair", [(0.8, 0.8, 0.5), (0.8, 0.4, 0.3), (0.9, 0.0, 0.0)])
def test_coverage(n, pair):
    """A percentile bootstrap covers 30 to 40 % of the last, and 100 % of the first."""
    x, y, order = populations(pair[:2], pair[2], n, 3, times=1000)
    low, high = strength_leads(x, y)[:, 0].T
    truth = 6 / np.pi * np.arcsin(np.array(pair[:2]) / 2)
    lead = truth[order[:, 0]] - truth[order[:, 1]]
    # 95 % less 3.5, and three standard errors of 1,000 samples.
    assert np.mean((low <= lead) & (lead <= high)) > 0.915 - 0.021


@pytest.mark.parametrize("n", [8, 20])
def test_the_strongest_of_five_equals_is_seldom_told_from_another(n):
    """Without regard to the choice it is in every fourth sample."""
    x, y, _ = populations((0.8,) * 5, 0.7, n, 3, times=1000)
    assert (strength_leads(x, y)[..., 0] > 0).any(axis=1).mean() < 0.05 + 0.021


def test_stiff_cases():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(3, 2))
    assert np.isnan(strength_leads(rng.normal(size=(2, 3)), y)).all()
    order = np.arange(6.0)
    leads = strength_leads(np.stack([order, -order, order[[1, 0, 2, 3, 5, 4]]]), order[:, None])
    assert np.isfinite(leads).all()
    assert leads[0] == pytest.approx([0, 0], abs=1.0)
    y = np.stack([order, order + 1e-3], axis=1)
    y[0, 1] = np.nan
    assert np.isfinite(strength_leads(rng.normal(size=(4, 6)), y)).all()
    assert strength_leads(order[None], y).shape == (0, 2)
