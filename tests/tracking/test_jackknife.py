"""The error by the choice of the test objects: against statistics by hand, in simulated studies."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tracking.findings.best_placement import best_placement
from tracking.findings.summary import seed_means
from tracking.statistics.jackknife import LEAST_ROUTES, sample_error


def mean_without(values, sizes=None, unit="route", placement="a", seed=1):
    """Left-out rows of a metric that is the mean over units, weighted by their sizes."""
    sizes = np.ones(len(values)) if sizes is None else np.asarray(sizes)
    whole, rest = np.sum(sizes * values), np.where(sizes < sizes.sum(), sizes.sum() - sizes, np.nan)
    table = {"left_out": [f"{unit} {i}" for i in range(len(values))], "ground_truths": sizes}
    table["value"] = (whole - sizes * values) / rest
    return pd.DataFrame(table).assign(placement=placement, seed=seed, unit=unit)


def test_it_is_the_error_of_a_mean():
    values = np.array([3.0, 8.0, 5.0, 1.0, 9.0])
    error = sample_error(mean_without(values), paired=False)
    assert error.variance == pytest.approx(stats.sem(values) ** 2)
    assert (error.degrees, error.unit) == (4, "route")


def test_what_a_unit_does_to_all_placements_cancels_between_them():
    random = np.random.default_rng(0)
    common, separate = 20 * random.normal(size=12), random.normal(size=(3, 12))
    pairs = zip("abc", common + separate, strict=True)
    rows = pd.concat(mean_without(y, unit="individual", placement=name) for name, y in pairs)
    single, paired = sample_error(rows, paired=False), sample_error(rows, paired=True)
    by_hand = np.sum((separate - separate.mean(axis=0)).var(axis=1, ddof=1)) / 2 / 12
    assert paired.variance == pytest.approx(by_hand)
    assert single.variance > 100 * paired.variance
    assert single.degrees == 11
    assert 11 < paired.degrees <= 22
    assert sample_error(rows[rows["placement"] == "a"], paired=True) is None


def test_the_larger_of_routes_and_individuals_counts_if_the_routes_are_enough():
    quiet, loud = np.arange(8.0), 10 * np.arange(8.0)

    def unit(routes, individuals):
        rows = [mean_without(routes), mean_without(individuals, unit="individual")]
        return sample_error(pd.concat(rows), paired=False).unit

    assert unit(loud, quiet) == "route"
    assert unit(quiet, loud) == "individual"
    assert unit(loud[: LEAST_ROUTES - 1], quiet) == "individual"
    # A route without objects is none.
    rows = mean_without(loud[:LEAST_ROUTES], [5, 5, 5, 0])
    assert sample_error(rows, paired=False) is None


def test_without_anything_to_leave_out_it_is_unknown():
    values = np.arange(6.0)
    alone = mean_without(values).assign(value=lambda t: t["value"].where(t.index > 0))
    assert sample_error(alone, paired=False) is None
    assert sample_error(mean_without(values)[:0], paired=False) is None
    assert sample_error(mean_without(values[:1], unit="individual"), paired=False) is None


def test_large_units_count_as_fewer():
    sizes = np.array([100] * 4 + [1] * 30)
    error = sample_error(mean_without(np.arange(34.0), sizes, "individual"), paired=False)
    assert 4 - 1 < error.degrees < 6


def test_false_alarms_count_by_how_they_differ_from_stretch_to_stretch():
    """Not by how many there are: each stretch of frames without its own raises AP."""
    rows = mean_without(np.array([3.0, 8.0, 5.0, 1.0, 9.0]), None, "individual")
    alone = sample_error(rows, paired=False)
    alarms = pd.DataFrame({"left_out": ["f 0", "f 1", "f 2", "f 3"], "ground_truths": 0.0})
    alarms = alarms.assign(placement="a", seed=1, unit="individual")
    alike = sample_error(pd.concat([rows, alarms.assign(value=20.0)]), paired=False)
    assert alike.variance == pytest.approx(alone.variance)
    gains = np.array([1.0, 2.0, 4.0, 2.0])
    differing = sample_error(pd.concat([rows, alarms.assign(value=20 + gains)]), paired=False)
    assert differing.variance - alone.variance == pytest.approx(3 * gains.var())
    assert differing.degrees == alone.degrees


def study(random, placements=4, seeds=3, units=12, shared=3.0, own=2.0, noise=0.5):
    """Results and left-out values of a metric that is a mean over units, all true means 50."""
    common = shared * random.standard_normal(units)
    values, left_out = [], []
    for i in range(placements):
        deviations = common + own * random.standard_normal(units)
        for seed in range(seeds):
            luck = noise * random.standard_normal()
            values.append((f"p{i}", seed, 50 + deviations.mean() + luck))
            left_out.append(mean_without(50 + deviations + luck, None, "individual", f"p{i}", seed))
    results = pd.DataFrame(values, columns=["placement", "seed", "value"])
    fixed = {"class": "Car", "detector": "d", "metric": "AP_R40_3D", "iou": 0.7}
    results = results.assign(**fixed, difficulty="all", ground_truths=100)
    return results, pd.concat(left_out).assign(**fixed)


def test_intervals_hold_the_truth_of_other_test_objects():
    random = np.random.default_rng(1)
    mean_held, lead_held, said = ({True: [], False: []} for _ in range(3))
    for _ in range(16):
        results, left_out = study(random)
        for has_left_out in (True, False):
            table = left_out if has_left_out else None
            means = seed_means(results, left_out=table)
            mean_held[has_left_out].append(((means["low"] <= 50) & (means["high"] >= 50)).mean())
            best = best_placement(results, left_out=table)
            lead_held[has_left_out].append((best.others["low"] <= 0).all())
            said[has_left_out].append(best.sure.iloc[0])
    assert np.mean(mean_held[True]) > 0.9 > 0.6 > np.mean(mean_held[False])
    assert np.mean(lead_held[True]) > 0.9 > 0.8 > np.mean(lead_held[False])
    assert np.mean(said[True]) < np.mean(said[False]) - 0.05  # the best of equals is one of four


def test_an_interval_by_hand():
    results, left_out = study(np.random.default_rng(2), placements=2)
    best = best_placement(results, left_out=left_out)
    wide = results.pivot(index="placement", columns="seed", values="value")
    seeds = wide.diff().iloc[1].var(ddof=1) / 2  # of the same seeds: paired
    error = sample_error(left_out, paired=True)
    assert best.sample.variance == error.variance
    whole = seeds / 3 + error.variance
    freedom = whole**2 / ((seeds / 3) ** 2 / 2 + error.variance**2 / error.degrees)
    half = stats.t.ppf(0.975, freedom) * np.sqrt(2 * whole)
    row = best.others.iloc[0]
    assert (row["high"] - row["low"]) / 2 == pytest.approx(half, rel=1e-6)
    means = seed_means(results, left_out=left_out)
    exact = stats.t.ppf(0.975, freedom) * np.sqrt(whole)
    assert means["half"].tolist() == pytest.approx([exact] * 2)
    single = sample_error(left_out, paired=False)
    assert means["sample_sd"].tolist() == pytest.approx(np.sqrt(np.diag(single.covariance)))


def test_without_a_table_and_with_one_seed_intervals_are_as_they_were():
    results, left_out = study(np.random.default_rng(3))
    pd.testing.assert_frame_equal(seed_means(results), seed_means(results, left_out=left_out[:0]))
    one = results[results["seed"] == 0]
    means = seed_means(one, left_out=left_out[left_out["seed"] == 0])
    assert means[["low", "high", "half"]].isna().all(axis=None)
    assert means["sample_sd"].notna().all()
    assert best_placement(one, left_out=left_out).others["low"].isna().all()


def test_what_a_seed_adds_to_all_placements_is_in_no_comparison():
    results, left_out = study(np.random.default_rng(4))
    kind = results["seed"].map({0: 30.0, 1: 0.0, 2: -30.0})
    harsh = results.assign(value=results["value"] + kind)
    plain, shifted = (seed_means(table, left_out=left_out) for table in (results, harsh))
    assert shifted["half"].tolist() == pytest.approx(plain["half"].tolist())
    assert ((shifted["high"] - shifted["low"]) > 3 * (plain["high"] - plain["low"])).all()
    # By hand: rows and columns of a table of placements and seeds taken out.
    y = harsh.pivot(index="placement", columns="seed", values="value")
    rest = y.sub(y.mean(axis=1), axis=0) - y.mean(axis=0) + y.to_numpy().mean()
    seeds, error = (rest**2).to_numpy().sum() / 6 / 3, sample_error(left_out, paired=True)
    whole = seeds + error.variance
    freedom = whole**2 / (seeds**2 / 6 + error.variance**2 / error.degrees)
    by_hand = stats.t.ppf(0.975, freedom) * np.sqrt(whole)
    assert shifted["half"].tolist() == pytest.approx([by_hand] * 4)
    # One that is missing: seeds are as if they were different.
    missing = seed_means(results[1:])
    assert missing["half"].tolist() == pytest.approx(
        ((missing["high"] - missing["low"]) / 2).tolist()
    )
    # So is one placement: there is nothing that it has in common with others.
    alone = seed_means(results[results["placement"] == "p0"])
    assert alone["half"].tolist() == pytest.approx(((alone["high"] - alone["low"]) / 2).tolist())
