"""The statistics against scipy and against brute force."""

import itertools
import math
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from statsmodels.stats.multitest import multipletests

from tests.refused import refused
from tests.tracking.result_tables import tables
from tracking.findings.correlation import correlate
from tracking.findings.paired import with_sums
from tracking.statistics.coefficients import COEFFICIENTS, permutation_p, scores

SCIPY = {"pearson": stats.pearsonr, "spearman": stats.spearmanr, "kendall": stats.kendalltau}
numbers = st.lists(st.integers(-3, 3), min_size=4, max_size=7)


@settings(max_examples=60)
@given(x=numbers, y=numbers, coefficient=st.sampled_from(COEFFICIENTS))
def test_coefficients_equal_scipy_also_with_ties(x, y, coefficient):
    n = min(len(x), len(y))
    a, b = np.array(x[:n], float), np.array(y[:n], float)
    ours = scores(a, coefficient) @ scores(b, coefficient)
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        assert np.isnan(ours)
    else:
        assert ours == pytest.approx(SCIPY[coefficient](a, b).statistic, abs=1e-12)


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
@pytest.mark.parametrize("ties", [False, True])
def test_exact_p_equals_scipys_permutation_test(coefficient, ties):
    rng = np.random.default_rng(3)
    x = rng.integers(0, 4, (3, 5)).astype(float) if ties else rng.normal(size=(3, 5))
    y = x[0] + rng.normal(size=5)
    statistic = partial(SCIPY[coefficient], y)
    for row, p in zip(x, permutation_p(x, y, coefficient), strict=True):
        test = stats.permutation_test(
            (row,), lambda x: statistic(x).statistic, permutation_type="pairings", n_resamples=10**6
        )
        assert p == pytest.approx(test.pvalue, abs=1e-12)
    assert np.isnan(permutation_p(x * np.nan, y, coefficient)).all()


def test_tied_coefficients_count_although_they_round_differently():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=5) * 1e6 + 1e9, rng.normal(size=5)
    x[1] = x[0]
    observed = np.corrcoef(x, y)[0, 1]
    null = [np.corrcoef(x, y[list(order)])[0, 1] for order in itertools.permutations(range(5))]
    less = sum(value <= observed + 1e-9 for value in null)
    greater = sum(value >= observed - 1e-9 for value in null)
    p = min(1.0, 2 * min(less, greater) / len(null))
    assert permutation_p(x[None], y, "pearson")[0] == pytest.approx(p, abs=1e-12)


@pytest.mark.parametrize("coefficient", COEFFICIENTS)
@pytest.mark.parametrize("rounded", [(), (0,), (1,), (0, 1)])
def test_p_in_the_tail_is_that_of_all_orders_of_nine(coefficient, rounded):
    rng = np.random.default_rng(3)
    y = 2 * rng.normal(size=9)
    samples = [y + rng.normal(size=9) / 8, y]
    samples = [np.round(one) if i in rounded else one for i, one in enumerate(samples)]
    of_x, of_y = (scores(one, coefficient) for one in samples)
    orders = np.array(list(itertools.permutations(range(9))), dtype=np.int8)
    if coefficient == "kendall":
        i, j = np.triu_indices(9, 1)
        signs = np.sign(samples[1] - samples[1][:, None])
        null = signs[orders[:, i], orders[:, j]] @ of_x / np.linalg.norm(signs[i, j])
    else:
        null = of_y[orders] @ of_x
    tail = np.mean(null >= of_x @ of_y - 1e-9)
    assert tail < 1e-3
    assert permutation_p(samples[0][None], samples[1], coefficient)[0] == pytest.approx(2 * tail)


def sums_of_products(x, y):
    """All orders of `y`: each choice of one half, and both halves in all orders."""
    half = np.array(list(itertools.permutations(range(5))))
    for chosen in map(list, itertools.combinations(range(10), 5)):
        rest = [i for i in range(10) if i not in chosen]
        yield ((y[chosen][half] @ x[:5])[:, None] + y[rest][half] @ x[5:]).ravel()


def test_p_of_ten_pairs_with_an_outlier_is_that_of_all_orders():
    ranks = np.arange(10.0)
    swapped = ranks[[1, 0, *range(2, 8), 9, 8]]
    outlier = np.array([0.3, -1, 0.7, 0.2, -0.4, 1.1, -0.8, 0.5, -0.2, 60])
    for coefficient, x, y in (("spearman", ranks, swapped), ("pearson", outlier**2, outlier)):
        x, y = scores(x, coefficient), scores(y, coefficient)
        tail = sum(np.count_nonzero(part >= x @ y - 1e-12) for part in sums_of_products(x, y))
        p = permutation_p(x[None], y, coefficient)[0]
        # From 499,999 orders, of which some must be as extreme.
        error = 4 * 2 * np.sqrt(tail / math.factorial(10) / 499_999)
        assert p == pytest.approx(2 * tail / math.factorial(10), abs=error)
    assert permutation_p(ranks[None], swapped, "spearman")[0] == 76 / math.factorial(10)


def test_p_of_true_nulls_is_not_smaller_than_it_may_be():
    rng = np.random.default_rng(0)
    p = permutation_p(rng.standard_t(2, (5_000, 10)), rng.standard_t(2, 10), "pearson")
    for level in (0.05, 0.01, 1e-3, 1e-4):
        assert np.sum(p <= level) <= 5_000 * level + 3 * np.sqrt(5_000 * level)


def test_the_interval_allows_for_the_noise_of_seeds():
    rng = np.random.default_rng(0)
    x = np.arange(12.0)
    mean = x + rng.normal(0, 4, 12)
    turn = np.where(np.arange(12) % 2, 1.0, -1.0)[:, None] * np.array([-1.0, 1.0])
    quiet, noisy = (correlate(*tables(x, mean[:, None] + d * turn)).iloc[0] for d in (0.0, 3.0))
    assert quiet["reliability"] == pytest.approx(1.0)
    assert noisy["reliability"] < 0.9
    for name in COEFFICIENTS:
        assert noisy[name] == pytest.approx(quiet[name])  # the means are the same
        assert noisy[f"{name}_high"] > quiet[f"{name}_high"]
    # What a seed adds to all placements alike lowers no correlation.
    shifted = correlate(*tables(x, mean[:, None] + np.array([-30.0, 30.0]))).iloc[0]
    pd.testing.assert_series_equal(shifted, quiet)


def test_many_tests_are_adjusted_and_the_same_test_counts_once():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 7)), rng.normal(size=(7, 2))
    named = {"s_mig": x[0], "ig": 100 + x[0], "covered_entropy": -x[0], "m_sog": x[1]}
    parts = [tables(values, y, surrogate=name) for name, values in named.items()]
    row = correlate(parts[0][0], pd.concat([part[1] for part in parts])).set_index("surrogate")
    pair = row["pearson_p"][["s_mig", "m_sog"]].to_numpy()
    assert (row["pearson_tests"] == 2).all()
    assert (row["pairs_tested"] == 4).all()
    holm = multipletests(pair, method="holm")[1]
    fdr = multipletests(pair, method="fdr_by")[1]
    for adjusted, name in ((holm, "pearson_holm"), (fdr, "pearson_fdr")):
        assert row.loc[["s_mig", "m_sog"], name].to_numpy() == pytest.approx(adjusted)
        assert row.loc["ig", name] == row.loc["covered_entropy", name] == row.loc["s_mig", name]


def test_a_test_without_a_coefficient_is_not_counted():
    rng = np.random.default_rng(2)
    y = rng.normal(size=(6, 2))
    results, flat = tables(np.full(6, 3.0), y, surrogate="h_pog")
    table = correlate(results, pd.concat([flat, tables(rng.normal(size=6), y)[1]]))
    assert table["spearman_tests"].tolist() == [1, 1]
    assert table["spearman_holm"].isna().tolist() == [True, False]
    assert table["spearman_holm"].iloc[1] == table["spearman_p"].iloc[1]


def test_thousands_of_placements():
    rng = np.random.default_rng(3)
    x = rng.normal(size=2000)
    row = correlate(*tables(x, (0.1 * x + rng.normal(size=2000))[:, None])).iloc[0]
    for name in COEFFICIENTS:
        assert 0 < row[f"{name}_low"] < row[name] < row[f"{name}_high"] < 0.2
        assert row[f"{name}_p"] < 0.01
    assert not row["exact"]


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_extreme_scales_of_a_surrogate(scale):
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=8), rng.normal(size=(8, 2))
    usual, extreme = (correlate(*tables(x * unit, y)).iloc[0] for unit in (1.0, scale))
    for name in COEFFICIENTS:
        for suffix in ("", "_low", "_high", "_p"):
            assert extreme[name + suffix] == pytest.approx(usual[name + suffix], rel=1e-9)


def test_means_over_seeds_and_no_sign():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=7), rng.normal(size=(7, 3))
    row = correlate(*tables(x, y)).iloc[0]
    turned = correlate(*tables(-x, y)).iloc[0]
    for name in COEFFICIENTS:
        assert row[name] == pytest.approx(SCIPY[name](x, y.mean(axis=1)).statistic)
        assert turned[name] == pytest.approx(-row[name])
        assert turned[f"{name}_p"] == pytest.approx(row[f"{name}_p"])
        assert row[f"{name}_low"] <= row[name] <= row[f"{name}_high"]
    assert (row["n"], row["seeds"], row["exact"], row["note"]) == (7, 3, True, "")


def test_few_placements_and_constants_say_why():
    y = np.arange(10.0).reshape(5, 2)
    two = correlate(*tables(np.arange(2.0), y[:2])).iloc[0]
    assert np.isnan(two["pearson"])
    assert two["note"] == "fewer than 3 placements"
    flat = correlate(*tables(np.full(5, 0.1), y)).iloc[0]
    assert np.isnan(flat["kendall_p"])
    assert np.isnan(flat["spearman_low"])
    assert flat["note"] == "s_mig is the same for every placement"
    ap = correlate(*tables(np.arange(5.0), np.full((5, 2), 0.1))).iloc[0]
    assert np.isnan(ap["spearman"])
    assert ap["note"] == "the metric is the same for every placement"
    five = correlate(*tables(np.arange(5.0), y)).iloc[0]
    assert five["note"] == "few placements: the smallest possible two-sided p is 0.017"
    assert five["pearson_p"] == pytest.approx(2 / 120)
    one_seed = correlate(*tables(np.arange(5.0), y[:, :1])).iloc[0]
    assert "one seed: the interval does not include seed noise" in one_seed["note"]
    assert np.isnan(one_seed["reliability"])
    three = correlate(*tables(np.arange(3.0), y[:3])).iloc[0]
    assert three["spearman"] == pytest.approx(1.0)
    assert np.isnan(three["spearman_low"])
    assert "3 placements are too few for an interval" in three["note"]


def test_missing_values_leave_placements_out():
    y = np.arange(12.0).reshape(6, 2) ** 2
    y[5] = np.nan
    y[0, 1] = np.nan
    row = correlate(*tables(np.arange(6.0), y)).iloc[0]
    assert (row["n"], row["seeds"]) == (5, 1)
    none = correlate(*tables(np.arange(6.0), np.full((6, 2), np.nan))).iloc[0]
    assert none["n"] == 0
    assert none["note"] == "no value: the class has no ground truth"


def test_recall_of_all_meets_the_sum_over_classes():
    results, _ = tables(np.arange(4.0), np.arange(8.0).reshape(4, 2), "all", metric="recall")
    parts = [
        tables(values, np.zeros((4, 1)), object_class, surrogate)[1]
        for object_class, values in (("Car", [0.0, 1, 2, 9]), ("Cyclist", [9.0, 0, 2, 5]))
        for surrogate in ("s_mig", "m_sog", "covered_voxels")
    ]
    table = correlate(results, pd.concat(parts))
    assert table["surrogate"].tolist() == ["s_mig"]
    total = stats.pearsonr([9, 1, 4, 14], [0.5, 2.5, 4.5, 6.5]).statistic
    assert table["pearson"].iloc[0] == pytest.approx(total)


def test_a_share_of_objects_is_averaged_over_classes():
    parts = [
        tables([share] * 3, np.zeros((3, 1)), name, "expected_recall")[1]
        for name, share in (("Car", 0.9), ("Cyclist", 0.5))
    ]
    summed = with_sums(pd.concat(parts)).query("`class` == 'all'")
    assert summed["value"].tolist() == pytest.approx([0.7] * 3)
    parts.append(tables([5.0] * 3, np.zeros((3, 1)), "Pedestrian", "s_mig")[1])
    summed = with_sums(pd.concat(parts)).query("surrogate == 'expected_recall'")
    assert summed.query("`class` == 'all'")["value"].tolist() == pytest.approx([0.7] * 3)


def test_a_sum_lacks_nothing_silently():
    parts = [tables([1.0, 2, 3], np.zeros((3, 1)), name)[1] for name in ("Car", "Cyclist")]
    parts[1].loc[1, "value"] = np.nan
    summed = with_sums(pd.concat(parts)).query("`class` == 'all'").set_index("placement")["value"]
    assert summed["p0"] == 2.0
    assert np.isnan(summed["p1"])


def test_axes_make_groups_and_missing_axis_values_match_any():
    rng = np.random.default_rng(0)
    both, predictors = [], []
    for density, sign in ((40, 1.0), (120, -1.0)):
        x = rng.normal(size=5)
        results, surrogates = tables(x, sign * x[:, None] + np.zeros(2))
        both.append(results.assign(**{"scene.density": density}))
        predictors.append(surrogates.assign(**{"scene.density": density}))
    any_density = tables(np.arange(5.0), np.zeros((5, 1)), surrogate="covered_voxels")[1]
    predictors.append(any_density.assign(**{"scene.density": np.nan}))
    table = correlate(pd.concat(both), pd.concat(predictors), axes=["scene.density"])
    pearson = table.set_index(["scene.density", "surrogate"])["pearson"]
    assert len(table) == 4
    assert pearson[40, "s_mig"] == pytest.approx(1.0)
    assert pearson[120, "s_mig"] == pytest.approx(-1.0)
    assert (table["pairs_tested"] == 4).all()


def test_an_axis_that_is_forgotten_is_an_error():
    results, surrogates = tables(np.arange(5.0), np.zeros((5, 2)))
    with refused(r"^results: duplicate rows \(placement=.*, seed=0\); name the axis"):
        correlate(pd.concat([results, results]), surrogates)
    with refused(("results", "metric", "placement, ")):
        correlate(results.drop(columns="metric"), surrogates)


def test_no_results_give_an_empty_table_with_all_columns():
    results, surrogates = tables(np.arange(3.0), np.zeros((3, 1)))
    table = correlate(results.iloc[:0], surrogates)
    assert table.empty
    assert {"spearman", "spearman_low", "kendall_p", "note", "pairs_tested"} <= {*table.columns}
