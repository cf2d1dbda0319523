"""What rigs that did not go on to all frames are worth: a population whose truth is known."""

import numpy as np
import pytest

from sweeps.search.trials.by_generalist import KEPT, PORTIONS, expected_on_all


def rigs(rng, n, spread=1.0, noise=2.0):
    """Values on the first frames and on all: portions scatter around what a rig is worth."""
    worth = 80 + spread * rng.standard_normal(n)
    portions = worth[:, None] + noise * rng.standard_normal((n, PORTIONS))
    return portions[:, 0], portions.mean(axis=1)


def test_laggards_are_neither_flattered_nor_punished():
    """By the mean change of the leaders, as it was, laggards came out 2.2 points too low here."""
    rng, off, shifted = np.random.default_rng(0), [], []
    for _ in range(300):
        first, whole = rigs(rng, 60)
        leads = first >= np.quantile(first, 1 - 1 / KEPT)
        both = list(zip(first[leads], whole[leads], strict=True))
        expected = np.array([expected_on_all(one, both) for one in first[~leads]])
        off.append((expected - whole[~leads]).mean())
        shifted.append((first + (whole - first)[leads].mean() - whole)[~leads].mean())
    assert np.mean(shifted) < -1.5, np.mean(shifted)
    assert np.mean(off) == pytest.approx(0, abs=0.25)  # the slope is kept above 1 / PORTIONS


def test_the_line_of_exact_values_is_met():
    first = np.array([70.0, 74.0, 80.0, 82.0])
    both = [(x, 20 + 0.7 * x) for x in first]
    assert expected_on_all(60.0, both) == pytest.approx(62.0)


@pytest.mark.parametrize(
    ("both", "expected"),
    [
        ([], 50.0),
        ([(60.0, 58.0)], 48.0),
        ([(60.0, 58.0), (60.0, 62.0), (60.0, 60.0)], 50.0),  # equal: no slope is known
        ([(60.0, 70.0), (61.0, 60.0), (62.0, 50.0)], 60 - 11 / PORTIONS),  # against all sense
        ([(60.0, 50.0), (61.0, 60.0), (62.0, 70.0)], 49.0),
    ],
)
def test_few_pairs(both, expected):
    assert expected_on_all(50.0, both) == pytest.approx(expected)
