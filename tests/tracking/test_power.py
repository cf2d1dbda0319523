"""Power against G*Power's exact bivariate normal model and by simulation."""

import numpy as np
import pytest
from scipy import stats

from tracking.statistics.power import placements_needed, power, power_table, smallest_detectable


@pytest.mark.parametrize(("rho", "n"), [(0.1, 782), (0.3, 84), (0.5, 29)])
def test_pearson_needs_what_gpower_says(rho, n):
    """Two-sided, 5 %, power 0.8: the exact model of G*Power 3.1."""
    assert placements_needed(rho) == n


@pytest.mark.parametrize(("rho", "n"), [(0.8, 8), (0.6, 20), (0.9, 6)])
@pytest.mark.parametrize("coefficient", ["pearson", "spearman"])
def test_power_by_simulation(rho, n, coefficient):
    rng = np.random.default_rng(3)
    r = rho if coefficient == "pearson" else 2 * np.sin(np.pi * rho / 6)
    x, e = rng.standard_normal((2, 4000, n))
    y = r * x + np.sqrt(1 - r**2) * e
    if coefficient == "pearson":
        shares = np.mean(stats.pearsonr(x, y, axis=1).pvalue <= 0.05)
    else:
        rank = stats.rankdata(x, axis=1), stats.rankdata(y, axis=1)
        values = stats.pearsonr(*rank, axis=1).statistic
        # Published exact critical values (Zar 1984).
        shares = np.mean(np.abs(values) >= {6: 0.886, 8: 0.738, 20: 0.447}[n] - 5e-4)
    assert power(rho, n, coefficient) == pytest.approx(shares, abs=0.035)


def test_noise_of_seeds_costs_power():
    noisy, exact = smallest_detectable(12, "pearson", 0.8), smallest_detectable(12)
    assert noisy == pytest.approx(exact / np.sqrt(0.8), abs=0.003)
    assert placements_needed(0.5, reliability=0.5) > 2 * placements_needed(0.5) - 5


def test_four_placements_find_nothing():
    table = power_table((3, 4, 5, 8, 20)).set_index("n")
    assert table.loc[[3, 4]].isna().all(axis=None)
    assert (table.loc[[5, 8, 20]].diff().dropna() < 0).all(axis=None)
    assert power(1.0, 4) == 0.0
    for rho in (0.0, 1e-6, 1e-3):
        assert power(rho, 30) == pytest.approx(0.05, abs=1e-4)
