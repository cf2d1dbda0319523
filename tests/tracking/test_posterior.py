"""The probability of being the best: brute force, and worlds drawn from the prior."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, special

from tracking.findings.best_placement import best_placement
from tracking.report.sections.regret import AT_RANDOM, regrets
from tracking.statistics.posterior import expected_regret, probability_of_best
from tracking.statistics.reliability import Noise


def probability(y, **options):
    """`y`: placements with their values by seed, of any length."""
    table = np.full((len(y), max(map(len, y))), np.nan)
    for row, values in zip(table, y, strict=True):
        row[: len(values)] = values
    means = np.array([np.mean(values) for values in y])
    return probability_of_best(means, Noise.of(table), **options)


def test_two_placements_by_quadrature():
    """The lead of two is shrunk by the share of noise, and has its share of the variance."""
    lead, variance, degrees, seeds = 2.0, 1.5, 4, 3

    def joint(log_sd, noise, weigh):
        sd = np.exp(log_sd)
        # The chi-square's density of the pooled variance, and the normal one of the lead.
        of_variance = sd**-degrees * np.exp(-degrees * variance / (2 * sd**2))
        # The share of noise of a half-Cauchy ratio of sds is a beta variable of 1/2 and 1/2.
        of_variance /= np.sqrt(noise * (1 - noise))
        of_lead = np.sqrt(noise) / sd * np.exp(-(lead**2) * seeds * noise / (4 * sd**2))
        wins = special.ndtr((1 - noise) * lead / (sd * np.sqrt(2 / seeds * (1 - noise))))
        return of_variance * of_lead * (wins if weigh else 1)

    total, wins = (
        integrate.dblquad(joint, 1e-9, 1 - 1e-9, -4, 5, args=(weigh,), epsabs=1e-6)[0]
        for weigh in (False, True)
    )
    noise = Noise(np.array([seeds, seeds]), variance, degrees)
    odds = probability_of_best(np.array([70.0, 72.0]), noise, draws=200_000)
    assert odds[1] == pytest.approx(wins / total, abs=0.004)


def test_unequal_seeds_by_weighted_draws_from_the_prior():
    y = [[1.0, 2, 4], [3.0, 5, 7], [4.0, 5.5]]
    rng, size = np.random.default_rng(0), 1_000_000
    noise, sd = rng.beta(0.5, 0.5, size), np.exp(rng.uniform(-2, 3, size))
    common = rng.uniform(-20, 28, size)
    of_mean = np.mean([1 / len(values) for values in y]) * sd**2
    between = np.sqrt((1 / noise - 1) * of_mean)
    truth = common + between * rng.standard_normal((3, size))
    weight = np.ones(size)
    for expected, values in zip(truth, y, strict=True):
        for value in values:
            weight *= np.exp(-((value - expected) ** 2) / (2 * sd**2)) / sd
    brute = np.bincount(truth.argmax(axis=0), weight) / weight.sum()
    # Some 2,600 draws' worth of weight: four standard errors.
    assert probability(y) == pytest.approx(brute, abs=0.04)


def test_it_happens_as_often_as_said():
    """Worlds drawn from the prior; a flat prior would say 0.11 more than happens."""
    rng = np.random.default_rng(1)
    claims, right, n, seeds = [], [], 6, 3
    for i in range(1500):
        between = np.abs(rng.standard_cauchy()) / np.sqrt(seeds)
        truth = between * rng.standard_normal(n)
        y = truth[:, None] + rng.standard_normal((n, seeds))
        odds = probability(y, seed=i, draws=500)
        best = y.mean(axis=1).argmax()
        claims.append(odds[best])
        right.append(truth.argmax() == best)
    assert np.mean(claims) == pytest.approx(np.mean(right), abs=3 * 0.5 / np.sqrt(len(claims)))
    sure = np.array(claims) > 0.9
    shares = np.mean(np.array(claims)[sure]), np.mean(np.array(right)[sure])
    assert shares[0] == pytest.approx(shares[1], abs=3 * 0.2 / np.sqrt(sure.sum()))


def test_units_and_level_do_not_count():
    y = np.random.default_rng(0).normal(size=(5, 3))
    expected = probability(y)
    assert probability(1e-3 * y) == pytest.approx(expected, abs=1e-3)
    assert probability(80 + y) == pytest.approx(expected, abs=1e-3)


def test_stiff_cases():
    assert np.isnan(probability([[1.0], [2.0]])).all()
    assert probability([[1.0, 2.0]]).tolist() == [1.0]
    assert probability([[1.0, 1.0], [3.0, 3.0], [3.0, 3.0]]).tolist() == [0.0, 0.5, 0.5]
    assert probability([[2.0, 2.0]] * 4).tolist() == [0.25] * 4
    hardly = [[1.0, 1.0 + 1e-12], [3.0, 3.0], [2.0, 2.0 - 1e-12]]
    assert probability(hardly)[1] > 0.999
    far = [[0.0, 1.0, 2.0], [1e9, 1e9 + 1, 1e9 + 2]]
    assert probability(far)[1] > 0.999


def test_a_larger_lead_is_surer_however_few_the_seeds():
    """With a prior of thinner tails two seeds each would never be more than 97.5 % sure."""
    noise, leads = Noise(np.array([2, 2]), variance=1.0, degrees=2), (1.0, 10.0, 100.0, 1e4)
    odds = [probability_of_best(np.array([lead, 0.0]), noise)[0] for lead in leads]
    assert odds == sorted(odds)
    assert odds[2] > 0.99
    assert odds[3] > 0.999


def worlds(times, n=6, seeds=3, draws=500):
    """Truth, found and said regret of two choices, in sd of the seeds: any, and a good one."""
    rng, rows = np.random.default_rng(7), []
    for i in range(times):
        between = np.abs(rng.standard_cauchy()) / np.sqrt(seeds)
        truth = between * rng.standard_normal(n)
        y = truth[:, None] + rng.standard_normal((n, seeds))
        means, noise = y.mean(axis=1), Noise.of(y)
        good = int(np.argmax(truth + between / 2 * rng.standard_normal(n)))
        regret = expected_regret(means, noise, np.eye(n)[[0, good]], i, draws)
        sd = np.sqrt(noise.variance)
        for name, choice, lost in zip(("any", "good"), (0, good), regret, strict=True):
            real, measured = truth.max() - truth[choice], means.max() - means[choice]
            rows.append((name, means.std() / sd, real / sd, measured / sd, *lost / sd))
    columns = ["choice", "spread", "true", "measured", "said", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def check(table):
    # Of data that spread as they do: the prior's tail would hide what noise does.
    any_choice = table[(table["choice"] == "any") & (table["spread"] < 2)]
    error = 4 * (any_choice["said"] - any_choice["true"]).std() / np.sqrt(len(any_choice))
    assert any_choice["said"].mean() == pytest.approx(any_choice["true"].mean(), abs=error)
    assert any_choice["measured"].mean() > any_choice["true"].mean() + error
    held = (table["low"] <= table["true"] + 1e-9) & (table["true"] <= table["high"] + 1e-9)
    for _, rows in held.groupby(table["choice"]):
        assert rows.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / len(rows))


def test_what_is_expected_happens_and_what_is_measured_is_too_much():
    check(worlds(600))


@pytest.mark.long
def test_the_same_in_many_worlds():
    check(worlds(10_000, draws=2000))


def test_without_noise_it_is_the_distance_to_the_best():
    y = np.array([[3.0, 3.0], [5.0, 5.0], [4.0, 4.0]])
    regret = expected_regret(y[:, 0], Noise.of(y), np.array([[1, 0, 0], [0, 1, 0], [1 / 3] * 3]))
    assert regret.tolist() == [pytest.approx([x] * 3) for x in (2.0, 0.0, 1.0)]
    assert np.isnan(expected_regret(y[:, 0], Noise.of(y[:, :1]), np.eye(3))).all()


def test_choices_of_surrogates():
    y = {"a": (70.0, 71), "b": (60.0, 61), "c": (66.0, 67)}
    rows = [(name, s, value) for name, seeds in y.items() for s, value in enumerate(seeds)]
    best = best_placement(pd.DataFrame(rows, columns=["placement", "seed", "value"]))
    values = {"covered_entropy": [1.0, 2, 3], "residual_entropy": [3.0, 1, 2]}
    values |= {"m_sog": [5.0, 5, 4], "h_pog": [1.0, 1, 1]}
    surrogates = pd.DataFrame(values, index=list("abc"))
    by_surrogate = regrets(best, surrogates).set_index("surrogate")
    choice = {"covered_entropy": "c", "residual_entropy": "b", "m_sog": "a, b", AT_RANDOM: ""}
    assert by_surrogate["choice"].to_dict() == choice
    assert by_surrogate["takes"].tolist() == ["highest", "lowest", "highest", "any"]
    assert by_surrogate["behind"].tolist() == pytest.approx([4, 10, 5, 14 / 3])
    assert (by_surrogate["low"] <= by_surrogate["regret"]).all()
    assert (by_surrogate["regret"] <= by_surrogate["high"]).all()
    assert by_surrogate["regret"]["residual_entropy"] == by_surrogate["regret"].max()
