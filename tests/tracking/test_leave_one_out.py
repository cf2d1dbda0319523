"""Coefficients and predictions without each placement, against scipy one at a time."""

import numpy as np
import pandas as pd
import pytest
from result_tables import tables
from scipy import stats

from tracking.findings.leave_one_out import leave_one_out

SCIPY = {"pearson": stats.pearsonr, "spearman": stats.spearmanr, "kendall": stats.kendalltau}


@pytest.mark.parametrize("ties", [False, True])
def test_equals_scipy_without_each_placement(ties):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=7), rng.normal(size=(7, 2))
    if ties:
        x = np.round(x)
    row = leave_one_out(*tables(x, y)).iloc[0]
    mean = y.mean(axis=1)
    for name, test in SCIPY.items():
        left = [test(np.delete(x, i), np.delete(mean, i)).statistic for i in range(7)]
        found = (row[f"{name}_min"], row[f"{name}_max"])
        assert found == pytest.approx((min(left), max(left)))
        change = np.abs(np.array(left) - test(x, mean).statistic)
        most = int(np.argmax(np.round(change, 12)))
        assert row[f"{name}_most"] == f"p{most}"
    lines = [np.polyfit(np.delete(x, i), np.delete(mean, i), 1) for i in range(7)]
    errors = [np.polyval(line, x[i]) - mean[i] for i, line in enumerate(lines)]
    assert row["rmse"] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    means = [np.delete(mean, i).mean() - mean[i] for i in range(7)]
    assert row["rmse_of_mean"] == pytest.approx(np.sqrt(np.mean(np.square(means))))


def test_one_placement_makes_a_correlation():
    x = np.array([0.0, 1, 0, 1, 0, 20])
    row = leave_one_out(*tables(x, np.array([[1.0], [0], [1], [0], [0.5], [30]]))).iloc[0]
    assert row["pearson_most"] == "p5"
    assert row["pearson_min"] < -0.8
    assert row["pearson_max"] > 0.99


def test_stiff_cases():
    y = np.arange(6.0)[:, None]
    few = leave_one_out(*tables(np.arange(3.0), y[:3])).iloc[0]
    assert (few["note"], few["pearson_most"]) == ("fewer than 4 placements", "")
    assert np.isnan(few["rmse"])
    flat = leave_one_out(*tables(np.full(6, 0.1), y)).iloc[0]
    assert flat["note"] == "the surrogate is the same for every placement"
    huge = leave_one_out(*tables(np.arange(6.0) * 1e300, y)).iloc[0]
    assert huge["rmse"] == pytest.approx(0, abs=1e-9)
    step = leave_one_out(*tables(np.array([0.0, 0, 0, 0, 0, 1]), y)).iloc[0]
    assert np.isfinite(step["pearson_max"])  # without p5 there is no coefficient
    results, surrogates = tables(np.arange(6.0), y)
    assert leave_one_out(results.iloc[:0], surrogates).empty
    assert isinstance(leave_one_out(results, surrogates), pd.DataFrame)
