import numpy as np
import pytest
from scipy import stats

from tracking.statistics.reliability import icc, pooled_variance, reliability_of_mean, seed_mean


def test_icc_by_the_analysis_of_variance():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(7, 1)) * 3 + rng.normal(size=(7, 4))
    f = stats.f_oneway(*y).statistic
    assert icc(y) == pytest.approx((f - 1) / (f + 3))


def test_published_icc():
    """Shrout and Fleiss (1979), table 2: six targets, four judges, ICC(1, 1) 0.17, (1, 4) 0.44."""
    ratings = np.array(
        [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7.0]]
    )
    assert icc(ratings) == pytest.approx(0.17, abs=0.005)
    assert reliability_of_mean(icc(ratings), 4) == pytest.approx(0.44, abs=0.005)


def test_unequal_seeds_recover_the_share_of_variance():
    rng = np.random.default_rng(1)
    y = rng.normal(size=(400, 60, 1)) + 0.5 * rng.normal(size=(400, 60, 3))
    y[:, ::2, 2] = np.nan
    assert np.mean(icc(y)) == pytest.approx(1 / 1.25, abs=0.01)
    assert np.mean(pooled_variance(y)[0]) == pytest.approx(0.25, rel=0.01)


def test_stiff_cases():
    assert np.isnan(icc(np.arange(5.0)[:, None]))
    assert np.isnan(icc(np.ones((4, 3))))
    assert np.isnan(icc(np.array([[1.0, 2.0]])))
    assert icc(np.array([[1.0, 2.0], [2.0, 1.0]])) == 0
    assert icc(np.array([[1.0, 1.0], [2.0, 2.0]])) == 1
    assert seed_mean(np.array([[np.nan, 3.0], [np.nan, np.nan]])) == pytest.approx(
        [3.0, np.nan], nan_ok=True
    )
