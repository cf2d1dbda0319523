"""The page of findings: every number is in the tables, and what its own code computes is right."""

import re
import sys
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "studies" / "findings"
NUMBER = re.compile(r"\d+(?:[.,]\d+)*")
OF_THE_DESIGN = {
    *("0.7", "0.5", "95"),  # IoUs and intervals
    *("4", "8", "16", "560", "1,120", "1"),  # LiDARs, beams, frames, and centimetres of mounts
    *("10", "30", "40"),  # bounds of distances, metres
    "0.1",  # q of expected IG by default
    "0.4",  # metres between the rigs of a controlled pair
    *("16,000", "97.5"),  # price of four vlp16, US dollars, and level of its test
}
"""Numbers that the words may hold: the configuration says them."""


@pytest.fixture(scope="module", autouse=True)
def _scripts_of_the_study():
    sys.path.insert(0, str(STUDY))
    yield
    sys.path.remove(str(STUDY))


PAGES = ["findings.md", "findings_tables.md"]


@pytest.mark.parametrize("name", ["findings.md", pytest.param(PAGES[1], marks=pytest.mark.long)])
def test_every_number_of_the_page_is_in_the_tables(name):
    from page import rendered

    page, anew = (ROOT / "docs" / name).read_text(encoding="utf-8"), rendered(name)

    # Another machine may round the last digit the other way.
    assert NUMBER.sub("#", page) == NUMBER.sub("#", anew)
    for line, other in zip(page.splitlines(), anew.splitlines(), strict=True):
        for one, two in zip(NUMBER.findall(line), NUMBER.findall(other), strict=True):
            digits = len(one.partition(".")[2])
            values = (float(number.replace(",", "")) for number in (one, two))
            assert abs(np.subtract(*values)) < 1.5 * 10**-digits, line


@pytest.mark.parametrize("name", PAGES)
def test_the_words_hold_no_number_of_their_own(name):
    from page import PAGES as TEMPLATES

    words = (STUDY / TEMPLATES[name]).read_text(encoding="utf-8")
    for looked_up_or_named in (r"\{\{.*?\}\}", r"\{%.*?%\}", r"`[^`]*`", r"\]\([^)]*\)"):
        words = re.sub(looked_up_or_named, "", words, flags=re.DOTALL)

    assert set(NUMBER.findall(words)) <= OF_THE_DESIGN


def test_parts_of_the_variance_are_means_over_all_orders():
    from combining import shares

    random = np.random.default_rng(0)
    x = pd.DataFrame(random.normal(size=(12, 3)), columns=list("abc"))
    x["b"] += x["a"]
    y = x["a"] - x["c"] + pd.Series(random.normal(size=12))

    def explained(columns: tuple[str, ...]) -> float:
        if not columns:
            return 0.0
        design = np.column_stack([np.ones(12), x[list(columns)]])
        left = np.linalg.lstsq(design, y, rcond=None)[1][0] / (12 - len(columns) - 1)
        return 1 - left / np.var(y, ddof=1)

    rises = {name: [] for name in x}
    for order in permutations(x):
        for place, name in enumerate(order):
            rises[name].append(explained(order[: place + 1]) - explained(order[:place]))

    averaged = {name: np.mean(gains) for name, gains in rises.items()}
    parts = shares(x, y)
    assert parts.to_dict() == pytest.approx(averaged)
    assert parts.sum() == pytest.approx(explained(("a", "b", "c")))


def test_terms_are_chosen_without_the_rig_that_is_predicted():
    from combining import combined

    random = np.random.default_rng(1)
    x = pd.DataFrame(random.normal(size=(20, 6)), columns=list("abcdef"))
    y = x["c"] + 0.1 * pd.Series(random.normal(size=20))
    noise = pd.Series(random.normal(size=20))

    result = combined(x, y, 1)

    assert result.terms == ("c",)
    assert result.rho > 0.95
    # Chosen from all rigs, the best of so many columns would seem to predict even noise.
    luck = x.corrwith(noise, method="spearman").abs().max()
    assert luck > 0.3 > combined(x, noise, 1).rho


def test_a_rig_that_is_left_out_takes_no_part_in_the_ranks_of_the_fit():
    from combining import combined
    from scipy.stats import percentileofscore, rankdata, spearmanr

    random = np.random.default_rng(2)
    x = random.integers(0, 12, 15).astype(float)  # with ties
    y = x + random.normal(0, 4, 15)
    predictions = []
    for rig in range(15):
        others, own_y = np.delete(x, rig), np.delete(y, rig)
        line = np.polynomial.Polynomial.fit(rankdata(others), rankdata(own_y), 1)
        rank = percentileofscore(others, x[rig], "mean") / 100 * len(others) + 0.5
        predictions.append(line(rank))

    result = combined(pd.DataFrame({"x": x}), pd.Series(y), 1)

    assert result.rho == pytest.approx(spearmanr(np.round(predictions, 9), y).statistic)


def test_chance_explains_nothing_of_the_variance():
    from combining import shares

    random = np.random.default_rng(3)
    sums = [
        shares(pd.DataFrame(random.normal(size=(25, 5))), pd.Series(random.normal(size=25))).sum()
        for _ in range(40)
    ]
    assert abs(np.mean(sums)) < 4 * np.std(sums) / np.sqrt(len(sums)) < 0.15


def gains_by_q(qs: np.ndarray) -> pd.DataFrame:
    """Expected IG of eight rigs, which differ in their voxels and in their rays a voxel."""
    random = np.random.default_rng(0)
    voxels, rays = random.uniform(1e3, 1e4, (8, 1)), random.uniform(1, 300, (8, 1))
    return pd.DataFrame(voxels * (1 - (1 - qs) ** rays), index=list("abcdefgh"), columns=qs)


@pytest.mark.parametrize("slope", [0.004, -0.004])
def test_a_true_q_is_found_and_a_rig_has_no_part_in_its_own_prediction(slope):
    from fitted import fit_detection_probability

    qs = np.geomspace(1e-3, 1, 13)
    gains = gains_by_q(qs)
    gains[qs[0]] = 1.0  # alike for all rigs
    ap = 70 + slope * gains[qs[4]]

    fitted = fit_detection_probability(gains, ap.sample(frac=1, random_state=0))
    assert (fitted.q, *fitted.placements["q"]) == (qs[4],) * 9
    np.testing.assert_allclose(fitted.placements["predicted"], ap, rtol=1e-9)
    assert fitted.rmse < 1e-9 < fitted.rmse_of_mean

    other = fit_detection_probability(gains, ap.where(ap.index != "c", 5.0)).placements.loc["c"]
    assert (other["q"], other["predicted"]) == (qs[4], pytest.approx(ap["c"]))


def test_a_fitted_q_predicts_no_noise():
    """Fitted to all rigs noise always looks predicted; left out it does not."""
    from fitted import fit_detection_probability

    random, gains = np.random.default_rng(1), gains_by_q(np.geomspace(1e-3, 1, 13))
    measured = [pd.Series(random.normal(70, 3, 8), gains.index) for _ in range(200)]
    fitted = [fit_detection_probability(gains, ap) for ap in measured]

    assert np.median([fit.rmse / fit.rmse_of_mean for fit in fitted]) > 1
    assert np.median([gains.corrwith(ap).abs().max() for ap in measured]) > 0.25
