"""Ceilings of correlations: brute force, worlds with a known truth, Spearman's formula."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.tracking.result_tables import tables
from tests.tracking.test_reliability import of_means
from tracking.findings.ceiling import ceiling, ceilings, with_ceilings
from tracking.findings.correlation import correlate


def world(rng, n, seeds, noise, predictor=1.0):
    """Draw the truth of n placements, a predictor of correlation `predictor`, and noisy metrics."""
    truth = rng.standard_normal(n)
    prediction = predictor * truth + np.sqrt(1 - predictor**2) * rng.standard_normal(n)
    return truth, prediction, truth[:, None] + noise * rng.standard_normal((n, seeds))


@pytest.mark.parametrize("predictor", [1.0, 0.8])
def test_noise_lowers_a_correlation_to_its_share_of_the_ceiling(predictor):
    """One sample so large that it is the population: reliability 1 / (1 + noise² / seeds)."""
    _, prediction, y = world(np.random.default_rng(1), 200_000, 2, 1.0, predictor)
    most = float(ceiling(of_means(y)[0]))
    reached = stats.spearmanr(prediction, y.mean(axis=1)).statistic
    pearson = np.sqrt(1 / 1.5) * np.array([1.0, predictor])
    expected = 6 / np.pi * np.arcsin(pearson / 2)
    assert [most, reached] == pytest.approx(expected, abs=0.005)


MANY = [pytest.param(n, sd, 4000, marks=pytest.mark.long) for n in (8, 24) for sd in (0.3, 1.0)]


@pytest.mark.parametrize(("placements", "noise", "times"), [(8, 1.0, 300), *MANY])
def test_intervals_of_the_reliability_hold_it_as_often_as_they_say(placements, noise, times):
    rng, held = np.random.default_rng(3), 0
    truth = 1 / (1 + noise**2 / 3)
    for _ in range(times):
        _, _, y = world(rng, placements, 3, noise)
        _, low, high = of_means(y)
        held += low <= truth <= high
    assert held / times == pytest.approx(0.95, abs=3.5 * np.sqrt(0.95 * 0.05 / times))


def drawn_objects(rng, skill, objects):
    """Draw which objects each placement finds: every object has its own difficulty."""
    difficulty = rng.normal(size=objects)
    chance = 1 / (1 + np.exp(difficulty - skill[:, None]))
    return rng.random((len(skill), objects)) < chance


def left_out_of(hits):
    """Recall of every placement without each object in turn, as `left_out.parquet` has it."""
    n, objects = hits.shape
    without = 100 * (hits.sum(axis=1, keepdims=True) - hits) / (objects - 1)
    rows = [(f"p{i}", str(j), without[i, j]) for i in range(n) for j in range(objects)]
    table = pd.DataFrame(rows, columns=["placement", "left_out", "value"])
    group = {"class": "Car", "detector": "d", "metric": "AP_R40_3D", "iou": 0.7}
    return table.assign(**group, seed=0, unit="individual", ground_truths=1)


@pytest.mark.parametrize("objects", [60, pytest.param(400, marks=pytest.mark.long)])
def test_halves_of_the_test_objects_agree_as_said(objects):
    """Brute force: two other halves of the test objects, of the same placements."""
    rng, estimates, brute = np.random.default_rng(4), [], []
    for _ in range(60):
        skill = rng.normal(scale=0.7, size=12)
        hits = drawn_objects(rng, skill, objects)
        results, _ = tables(range(12), 100 * hits.mean(axis=1, keepdims=True))
        (row,) = ceilings(results, left_out_of(hits)).to_dict("records")
        estimates.append(row["agreement_of_halves"])
        halves = [drawn_objects(rng, skill, objects // 2).mean(axis=1) for _ in range(2)]
        brute.append(np.corrcoef(halves)[0, 1])
    error = np.std(np.subtract(estimates, brute)) / np.sqrt(60)
    assert np.mean(estimates) == pytest.approx(np.mean(brute), abs=4 * error)
    assert error < 0.05


def test_the_whole_ceiling_has_seeds_and_objects():
    rng = np.random.default_rng(5)
    hits = drawn_objects(rng, rng.normal(size=10), 80)
    y = 100 * hits.mean(axis=1, keepdims=True) + 3 * rng.standard_normal((10, 3))
    results, surrogates = tables(range(10), y)
    left_out = left_out_of(hits)
    (alone,), (both,) = (ceilings(results, t).to_dict("records") for t in (None, left_out))
    assert alone["ceiling"] == alone["ceiling_by_seeds"] > both["ceiling"]
    assert both["ceiling"] < both["ceiling_by_objects"]
    assert both["ceiling_low"] < both["ceiling"] < both["ceiling_high"]
    assert (alone["unit"], both["unit"]) == ("", "individual")
    (one,) = ceilings(results[results["seed"] == 0], left_out).to_dict("records")
    assert np.isnan(one["ceiling_by_seeds"])
    assert one["ceiling"] == one["ceiling_by_objects"]
    table = with_ceilings(correlate(results, surrogates), ceilings(results, left_out))
    assert table["ceiling"].tolist() == [both["ceiling"]]


def test_detectors_that_agree_in_a_part():
    """Each is that part and as much of its own: they correlate by a half, with the part by √½."""
    rng = np.random.default_rng(6)
    part = rng.standard_normal(5000)
    truths = [part + rng.standard_normal(5000) for _ in range(3)]
    results = pd.concat(
        tables(part, values[:, None])[0].assign(detector=f"d{i}") for i, values in enumerate(truths)
    )
    computed = ceilings(results)
    rho = stats.spearmanr(part, truths[0]).statistic
    assert computed["ceiling_by_detectors"].tolist() == pytest.approx([rho] * 3, abs=0.02)
    agreement = 6 / np.pi * np.arcsin(1 / 4)
    assert computed["agreement_of_detectors"].iloc[0] == pytest.approx(agreement, abs=0.02)
    assert ceiling(np.array([0.0, 1.0])).tolist() == pytest.approx([0, 1])


def test_two_seeds_agree_whatever_their_level():
    _, _, y = world(np.random.default_rng(8), 7, 3, 0.5)
    stricter = y - np.array([0, 5, 9])
    one, other = (
        ceilings(tables(range(7), table)[0])["agreement_of_seeds"].item() for table in (y, stricter)
    )
    assert one == pytest.approx(other)
    # ICC(3, 1) by the two-way analysis of variance (Shrout and Fleiss 1979).
    rest = y - y.mean(axis=0) - y.mean(axis=1, keepdims=True) + y.mean()
    between, error = 3 * y.mean(axis=1).var(ddof=1), (rest**2).sum() / (6 * 2)
    assert one == pytest.approx((between - error) / (between + 2 * error))
