"""The best placement against scipy's Tukey test."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tracking.findings.best_placement import best_placement


def results(y):
    """`y`: by placement, the values by seed."""
    rows = [(name, seed, v) for name, values in y.items() for seed, v in enumerate(values)]
    return pd.DataFrame(rows, columns=["placement", "seed", "value"])


def test_equals_tukey_hsd_for_unequal_seeds():
    y = {"a": [70.0, 72, 71], "b": [75.0, 74], "c": [73.0, 76, 77, 75], "d": [60.0, 66]}
    ranking = best_placement(results(y))
    theirs = stats.tukey_hsd(*y.values())
    bounds = theirs.confidence_interval(0.95)
    assert ranking.best == "c"
    assert ranking.others.index.tolist() == ["b", "a", "d"]
    for name, row in ranking.others.iterrows():
        at = 2, list(y).index(name)
        assert row["lead"] == pytest.approx(theirs.statistic[at])
        assert ranking.p[name] == pytest.approx(theirs.pvalue[at], abs=1e-6)
        expected = (bounds.low[at], bounds.high[at])
        assert (row["low"], row["high"]) == pytest.approx(expected, abs=1e-3)
    assert ranking.tied == ["b", "a"]
    against = ranking.differences("b")
    assert against.index.tolist() == ["c", "b", "a", "d"]
    for name in "acd":
        at = list(y).index(name), 1
        expected = (theirs.statistic[at], bounds.low[at], bounds.high[at])
        assert against.loc[name].tolist() == pytest.approx(expected, abs=1e-3)
    with pytest.raises(KeyError):
        ranking.differences("e")


def test_two_placements_of_the_same_seeds_are_a_paired_t_test():
    y = {"a": [1.0, 2, 4], "b": [3.0, 5, 7]}
    ranking = best_placement(results(y))
    test = stats.ttest_rel(y["b"], y["a"])
    assert ranking.p.iloc[0] == pytest.approx(test.pvalue, abs=1e-6)
    bounds = test.confidence_interval(0.95)
    row = ranking.others.iloc[0]
    assert (row["low"], row["high"]) == pytest.approx((bounds.low, bounds.high), abs=1e-3)
    # Less sure than a flat prior, which turns the one-sided p into the probability.
    assert 0.5 < ranking.sure["b"] < 1 - test.pvalue / 2
    assert ranking.sure.sum() == pytest.approx(1)


def test_one_seed_says_why_there_is_no_interval():
    ranking = best_placement(results({"a": [1.0], "b": [3.0]}))
    assert (ranking.best, ranking.others.loc["a", "lead"]) == ("b", 2.0)
    assert np.isnan(ranking.others.loc["a", "low"])
    assert ranking.sure.isna().all()
    assert ranking.tied == ["a"]
    assert "one seed each" in ranking.note


def test_missing_values_and_single_placements():
    ranking = best_placement(results({"a": [1.0, np.nan], "b": [3.0, 4.0], "c": [np.nan, np.nan]}))
    assert ranking.others["seeds"].to_dict() == {"a": 1}
    assert np.isfinite(ranking.others.loc["a", "low"])
    assert best_placement(results({"a": [np.nan]})) is None
    alone = best_placement(results({"a": [1.0, 2.0]}))
    assert alone.others.empty
    assert alone.sure["a"] == 1
    assert "nothing to compare" in alone.note


def test_no_spread_over_seeds():
    ranking = best_placement(results({"a": [1.0, 1.0], "b": [3.0, 3.0], "c": [3.0, 3.0]}))
    assert ranking.p.to_dict() == {"c": 1.0, "a": 0.0}
    assert ranking.others.loc["a", "low"] == 2.0


def test_the_area_decides_where_it_is_known():
    """AP_R40 has b ahead, by its steps; the area under the same curves has a ahead."""
    y = {"a": [70.0, 71.0], "b": [71.0, 72.0]}
    whole = results({"a": [70.4, 71.4], "b": [70.0, 71.0]}).assign(unit="nothing", left_out="")
    whole = whole.assign(ground_truths=0)
    ranking = best_placement(results(y), left_out=whole)
    assert (ranking.best, ranking.mean) == ("a", 70.5)
    assert ranking.others.loc["b", ["mean", "lead"]].tolist() == pytest.approx([71.5, 0.4])
    assert ranking.differences("b")["difference"].tolist() == pytest.approx([0.4, 0.0])
    # Of some placements alone it is in no comparison.
    assert best_placement(results(y), left_out=whole[whole["placement"] == "a"]).best == "b"


def test_one_judge_leaves_the_error_of_the_test_objects():
    y = {"a": [70.0], "b": [72.0], "c": [60.0]}
    rows = [
        (name, 0, "route", f"r{unit}", 10, value + (1 if name == "b" else -1) * (unit - 2) / 10)
        for name, (value,) in y.items()
        for unit in range(5)
    ]
    columns = ["placement", "seed", "unit", "left_out", "ground_truths", "value"]
    left_out = pd.DataFrame(rows, columns=columns)
    ranking = best_placement(results(y), left_out=left_out, generalist=True)
    assert ranking.note.startswith("one generalist")
    row = ranking.others.loc["a"]
    assert row["low"] < row["lead"] < row["high"]
    # By hand: the jackknife variance of each placement against the mean of all, twice for two.
    deviations = np.array([[-1.0, 1, -1]]) * (np.arange(5)[:, None] - 2) / 10
    deviations -= deviations.mean(axis=1, keepdims=True)
    variance = 4 / 5 * (deviations**2).sum() / 2
    half = stats.studentized_range.ppf(0.95, 3, ranking.noise.degrees) * np.sqrt(variance)
    assert row["high"] - row["lead"] == pytest.approx(half, rel=1e-6)
    assert best_placement(results(y), left_out=left_out).others["low"].isna().all()
