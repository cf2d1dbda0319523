"""The ranking of surrogates where the truth is known."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.tracking.result_tables import tables
from tracking.findings.best_surrogate import best_surrogates
from tracking.findings.correlation import correlate, leave_one_out


def found(y, **surrogates):
    parts = [tables(x, y, surrogate=name) for name, x in surrogates.items()]
    both = parts[0][0], pd.concat([part[1] for part in parts])
    return best_surrogates(*both, correlate(*both), leave_one_out(*both))


def test_the_surrogate_that_makes_the_metric_wins():
    rng = np.random.default_rng(0)
    x, other = rng.normal(size=(2, 20))
    y = 5 * x[:, None] + 0.3 * rng.normal(size=(20, 3))
    one = found(y, m_sog=other, s_mig=-x, covered_entropy=x)[0]
    assert one.predictor == "s_mig"
    assert one.ranking.index.tolist() == ["s_mig", "covered_entropy", "m_sog"]
    assert one.ranking["same_as"].tolist() == ["", "s_mig", ""]
    row = one.ranking.loc["m_sog"]
    rho = abs(stats.spearmanr(other, y.mean(axis=1)).statistic)
    assert row["behind"] == pytest.approx(one.ranking["spearman"].abs().iloc[0] - rho)
    assert 0 < row["behind_low"] < row["behind_high"]
    assert one.sentence.startswith("Car, 3D AP @ 0.7: S-MIG predicts it (ρ = −")


def test_surrogates_that_order_alike_count_once():
    """The more surrogates, the wider the intervals: not for those that are one test."""
    rng = np.random.default_rng(0)
    x, other = rng.normal(size=(2, 12))
    y = x[:, None] + 0.5 * rng.normal(size=(12, 3))
    two = found(y, s_mig=x, m_sog=other)[0].ranking
    four = found(y, s_mig=x, covered_entropy=-x, m_sog=other, expected_points=np.exp(other))[0]
    columns = ["behind", "behind_low", "behind_high"]
    expected = two.loc["m_sog", columns].tolist()
    for name in ("m_sog", "expected_points"):
        assert four.ranking.loc[name, columns].tolist() == pytest.approx(expected)
    assert four.ranking.loc["covered_entropy", columns].isna().all()


def test_noise_predicts_nothing():
    rng = np.random.default_rng(1)
    one = found(rng.normal(size=(8, 2)), s_mig=rng.normal(size=8), m_sog=rng.normal(size=8))[0]
    assert one.predictor == ""
    assert "no surrogate predicts it significantly" in one.sentence


def test_a_significant_surrogate_that_mispredicts_is_no_predictor():
    """A perfect order with one placement far off any line."""
    x = np.arange(8.0)
    one = found(np.append(x[:7], 1e4)[:, None], s_mig=np.append(x[:7], 7.0))[0]
    assert one.ranking["holm"].iloc[0] < 0.05
    assert one.ranking["rmse"].iloc[0] > one.ranking["rmse_of_mean"].iloc[0]
    assert one.predictor == ""


def test_groups_without_a_coefficient_are_left_out():
    y = np.arange(10.0).reshape(5, 2)
    assert found(y, s_mig=np.ones(5)) == []
    assert found(y[:2], s_mig=np.arange(2.0)) == []
    assert found(np.full((5, 2), np.nan), s_mig=np.arange(5.0)) == []


@pytest.mark.parametrize("ties", [False, True])
def test_equals_scipy_without_each_placement(ties):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=7), rng.normal(size=(7, 2))
    if ties:
        x = np.round(x)
    row = leave_one_out(*tables(x, y)).iloc[0]
    mean = y.mean(axis=1)
    left = [stats.spearmanr(np.delete(x, i), np.delete(mean, i)).statistic for i in range(7)]
    assert row[["spearman_min", "spearman_max"]].tolist() == pytest.approx([min(left), max(left)])
    lines = [np.polyfit(np.delete(x, i), np.delete(mean, i), 1) for i in range(7)]
    errors = [np.polyval(line, x[i]) - mean[i] for i, line in enumerate(lines)]
    assert row["rmse"] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    means = [np.delete(mean, i).mean() - mean[i] for i in range(7)]
    assert row["rmse_of_mean"] == pytest.approx(np.sqrt(np.mean(np.square(means))))


def test_stiff_cases():
    y = np.arange(6.0)[:, None]
    few = leave_one_out(*tables(np.arange(3.0), y[:3])).iloc[0]
    assert few["note"] == "fewer than 4 placements"
    assert np.isnan(few["spearman_min"])
    assert np.isnan(few["rmse"])
    flat = leave_one_out(*tables(np.full(6, 0.1), y)).iloc[0]
    assert flat["note"] == "the surrogate is the same for every placement"
    huge = leave_one_out(*tables(np.arange(6.0) * 1e300, y)).iloc[0]
    assert huge["rmse"] == pytest.approx(0, abs=1e-9)
    step = leave_one_out(*tables(np.array([0.0, 0, 0, 0, 0, 1]), y)).iloc[0]
    assert np.isfinite(step["spearman_max"])  # without p5 there is no coefficient
    results, surrogates = tables(np.arange(6.0), y)
    assert leave_one_out(results.iloc[:0], surrogates).empty
