import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.stats.multitest import multipletests

from tracking.statistics.multiple_tests import adjust, distinct_tests, holm


@settings(max_examples=20)
@given(st.lists(st.floats(1e-6, 1), min_size=1, max_size=12))
def test_holm_equals_statsmodels(values):
    p = np.array(values)
    assert holm(p) == pytest.approx(multipletests(p, method="holm")[1])


def test_one_test_that_occurs_twice_counts_once():
    p = np.array([0.01, np.nan, 0.01, 0.04, 0.03])
    counted_as = np.array([0, 1, 0, 3, 4])
    own = [0.01, 0.04, 0.03]
    for method, theirs in (("holm", "holm"), ("fdr", "fdr_by")):
        a, b, c = multipletests(own, method=theirs)[1]
        expected = [a, np.nan, a, b, c]
        assert adjust(p, counted_as, method) == pytest.approx(expected, nan_ok=True)


def test_without_any_test():
    assert np.isnan(adjust(np.full(2, np.nan), np.arange(2), "fdr")).all()
    assert len(adjust(np.empty(0), np.empty(0, dtype=int), "holm")) == 0


def test_samples_that_order_alike():
    x = np.array([[1, 2, 3, 4], [2, 4, 6, 8], [1, 4, 9, 16], [-1, -2, -3, -4], [0, 0, 0, 0.0]])
    assert distinct_tests(x, "pearson").tolist() == [0, 0, 2, 0, 4]
    assert distinct_tests(x, "spearman").tolist() == [0, 0, 0, 0, 4]
