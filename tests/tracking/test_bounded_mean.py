"""Intervals of shares: exact coverage, and those of the pages for few individuals."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.tracking.test_jackknife import mean_without
from tracking.findings.summary import seed_means
from tracking.statistics.bounded_mean import with_one_at_each_bound


def interval(mean, variance, n, low, high):
    """Student's, as `seed_means` makes it."""
    centre, of_all = with_one_at_each_bound(mean, variance, n, low, high)
    half = stats.t.ppf(0.975, n - 1) * np.sqrt(of_all)
    return centre - half, centre + half


@pytest.mark.parametrize("n", [6, 10, 30, 100, 300])
def test_shares_of_independent_individuals_are_covered_at_every_truth(n):
    hits = np.arange(n + 1)
    share = hits / n
    low, high = interval(share, share * (1 - share) / (n - 1), n, 0.0, 1.0)
    truth = np.linspace(0.5, 0.999, 500)[:, None]
    inside = (low <= truth) & (truth <= high)
    covered = (stats.binom.pmf(hits, n, truth) * inside).sum(axis=1)
    assert covered.min() > 0.93
    assert covered[truth[:, 0] > 0.9].min() > 0.935
    wilson = stats.binomtest(n, n).proportion_ci(method="wilson").low
    assert low[-1] == pytest.approx(wilson, abs=0.03)
    assert ((low <= share) & (share <= high)).all()


def test_differences_of_shares_are_covered():
    rng = np.random.default_rng(0)
    for n in (5, 10, 30):
        for first, second in ((0.02, 0.02), (0.1, 0.1), (0.6, 0.0), (0.8, 0.05)):
            chances = [first, second, 1 - first - second]
            alone = rng.choice([1.0, -1.0, 0.0], p=chances, size=(4000, n))
            variance = stats.sem(alone, axis=1) ** 2
            low, high = interval(alone.mean(axis=1), variance, n, -1.0, 1.0)
            assert ((low <= first - second) & (first - second <= high)).mean() > 0.935


def recall(shares, boxes=None, members=1.0):
    """Compute `seed_means` of the recall of individuals."""
    rows = mean_without(100 * np.asarray(shares), boxes, "individual").assign(members=members)
    fixed = {"class": "Car", "detector": "d", "metric": "recall", "iou": 0.5}
    weights = np.ones(len(rows)) if boxes is None else boxes
    value = 100 * np.average(shares, weights=weights)
    results = pd.DataFrame([{"placement": "a", "seed": 1, "value": value, **fixed}])
    results = results.assign(difficulty="all", ground_truths=len(rows))
    return seed_means(results, (), rows.assign(**fixed), "generalist").iloc[0]


def test_few_individuals_that_are_all_found_are_no_certainty():
    row = recall([1] * 6)
    assert row["mean"] == row["high"] == 100
    assert 54.1 < row["low"] < 61.0  # of Clopper and Pearson, and of Wilson
    assert row["low"] == pytest.approx(59.10, abs=0.01)
    none = recall([0] * 6)
    assert (none["low"], none["high"]) == (0, pytest.approx(100 - row["low"]))
    # Boxes of one individual are no individuals; those in a group are.
    assert recall([1] * 7, [500, 1, 1, 1, 1, 1, 1])["low"] < 20
    assert recall([1] * 100)["low"] == pytest.approx(97.1, abs=0.1)
    assert recall([1] * 100, members=3.0)["low"] == pytest.approx(99.0, abs=0.1)


def test_every_rig_has_the_error_of_its_own_recall():
    both = [recall([1] * 27 + [0] * 3), recall([1] * 15 + [0] * 15)]
    tables = [
        mean_without(100.0 * np.repeat([1, 0], [k, 30 - k]), None, "individual", name)
        for name, k in (("a", 27), ("b", 15))
    ]
    fixed = {"class": "Car", "detector": "d", "metric": "recall", "iou": 0.5}
    results = pd.DataFrame({"placement": ["a", "b"], "seed": 1, "value": [90.0, 50.0], **fixed})
    results = results.assign(difficulty="all", ground_truths=30)
    means = seed_means(results, (), pd.concat(tables).assign(**fixed), "generalist")
    for column in ("sample_sd", "low", "high"):
        assert means[column].tolist() == pytest.approx([row[column] for row in both])
